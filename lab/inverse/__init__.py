"""The inverse dynamic model of a joint whose torque was measured: torque as a function of the motion.

A controller that holds a joint to its reference makes the torque follow every disturbance, so the torque is no free
input: a forward model that is fitted to the angle then takes disturbances for inertia (on a UR10e's first joint 2.5
for 0.5).  The motion is what is given, and the torque what is noisy; that is the standard of robot identification:
M. Gautier and W. Khalil, "Exciting trajectories for the identification of base inertial parameters of robots", 1992;
A. Janot, P.-O. Vandanjon and M. Gautier, "A generic instrumental variable approach for industrial robot
identification", 2014.
"""
