"""Estimation of free parameters from recordings: strategy, fit with intervals, identifiability."""
