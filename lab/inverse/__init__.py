"""The search for missing effects in models with one moving part: joints, servos and oscillators.

The error that is minimised depends on the input.  The torque of a controlled joint reacts to every disturbance, and a
forward model fitted to the angle would attribute disturbances to the inertia (on the first joint of a UR10e 2.5 for 0.5
kg m²).  So the motion is taken as given and the torque as noisy (inverse dynamic model).  A command or a force does not
react to disturbances, and a free motion has no input: there the whole motion is simulated (output error).

References: M. Gautier and W. Khalil, "Exciting trajectories for the identification of base inertial parameters of
robots", 1992; A. Janot, P.-O. Vandanjon and M. Gautier, "A generic instrumental variable approach for industrial robot
identification", 2014; L. Ljung, System Identification, 1999.
"""
