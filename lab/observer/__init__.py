"""Observers: a constant-gain Kalman filter, and a global search by its prediction error."""
