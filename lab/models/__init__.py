"""Model files, effects added to them, effects of one's own, recordings simulated from them."""
