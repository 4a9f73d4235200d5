"""What was measured: experiments, the noise in them, where the sensor clips."""
