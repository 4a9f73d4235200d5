"""Free parameters from recordings: the strategy, the fit and its intervals, what recordings cannot tell."""
