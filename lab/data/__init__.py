"""Measured data: recordings prepared for a model, the repair of their readings, their noise, and tests of residuals."""
