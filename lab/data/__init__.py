"""Measured data: experiments, their noise, clipping of the sensor."""
