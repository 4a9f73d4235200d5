"""What is missing from a model with one moving part: joints, servos and oscillators.

The error that is minimised depends on what the input follows.  The torque of a controlled joint follows every
disturbance: a forward model fitted to the angle then attributes disturbances to the inertia (on a UR10e's first joint
2.5 for 0.5).  The motion is then given and the torque noisy (inverse dynamic model).  A command or a force follows no
disturbance, nor does a free motion, and the whole motion is simulated (output error).

References: M. Gautier and W. Khalil, "Exciting trajectories for the identification of base inertial parameters of
robots", 1992; A. Janot, P.-O. Vandanjon and M. Gautier, "A generic instrumental variable approach for industrial robot
identification", 2014; L. Ljung, System Identification, 1999.
"""
