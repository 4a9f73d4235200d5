"""Models that are corrected by the measurement at every sample: a constant-gain filter, and searches by its error."""
