"""The signals of a model, in causal order: a term that targets one may read every earlier one, and only those.

No physics here.  All bases share this one order; a signal that a base does not use stays at zero.  Compiled kernels
hold these numbers as constants, so the order is part of the name of their cache (``LAYOUT``, used by kernel.py).
"""

from __future__ import annotations

import zlib

__all__ = [
    "ALPHA2",
    "BAR_FORCE",
    "COMMAND",
    "COMMAND_RATE",
    "DISPLACED",
    "DRIVEN",
    "FORCE",
    "GAP",
    "GAP_RATE",
    "INERTIA",
    "LAYOUT",
    "OMEGA1",
    "OMEGA2",
    "QDD",
    "Q_RATE",
    "READING",
    "SENSOR",
    "SIGNALS",
    "THETA1",
    "THETA2",
    "TIME",
    "TIP",
    "TORQUE",
    "Q",
]

TIME = 0
"""t [s]"""
DRIVEN = 1
"""1 while there is an input, 0 in a ring-down or free swing [-]"""
COMMAND = 2
"""the input as it was commanded [rad]"""
COMMAND_RATE = 3
"""its derivative [rad/s]"""
THETA1 = 4
"""angle of the driving gear; on a servo the angle its controller aims at [rad]"""
OMEGA1 = 5
"""theta_1' [rad/s]"""
THETA2 = 6
"""angle of the joint's output, a state [rad]"""
OMEGA2 = 7
"""theta_2', a state [rad/s]"""
Q = 8
"""deflection of the oscillator, a state [m]"""
Q_RATE = 9
"""q', a state [m/s]"""
INERTIA = 10
"""what the torque accelerates [kg m²]"""
GAP = 11
"""delta_d of eq. 4 [m]"""
GAP_RATE = 12
"""delta_v of eq. 5 [m/s]"""
FORCE = 13
"""play: contact force F_cnt [N]; joint, servo: transmitted torque [N m]; oscillator: force on it [N]"""
TORQUE = 14
"""sum of the torques on the joint [N m]"""
ALPHA2 = 15
"""theta_2'' (the paper's omega_2') [rad/s²]"""
BAR_FORCE = 16
"""sum of the forces on the oscillator's mass [N]"""
QDD = 17
"""q'' [m/s²]"""
TIP = 18
"""acceleration that the sensor feels at the bar's free end [m/s²]"""
SENSOR = 19
"""the same behind the sensor's filter [m/s²]"""
READING = 20
"""the sensor's reading: with offset, drift and limits [m/s²]"""

DISPLACED = 21
"""displacement of the oscillator's end, of all its modes [m]"""

_NUMBERS = {name: number for name, number in dict(globals()).items() if type(number) is int}
SIGNALS = len(_NUMBERS)
LAYOUT = f"{zlib.crc32(' '.join(sorted(_NUMBERS, key=_NUMBERS.__getitem__)).encode()):08x}"
