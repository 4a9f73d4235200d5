"""What no effect explains: in which equation a misfit acts, and the unknown function that describes it."""
