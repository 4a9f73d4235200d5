"""What is plugged in, found by listening and by questions that change nothing; what it means is the caller's affair."""
