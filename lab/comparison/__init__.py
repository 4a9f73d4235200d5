"""Comparison of a model with measurements: prediction, residual analysis, ladder of errors."""
