"""What is plugged in, found by listening and by requests that change nothing; the caller interprets it."""
