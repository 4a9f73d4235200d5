"""Model discrepancy that no effect explains: the equation in which it acts, and a function that describes it."""
