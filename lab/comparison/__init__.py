"""A model held against measurements: prediction, residual analysis, the falling error."""
