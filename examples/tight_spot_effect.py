"""A joint that rubs over a part of its range: an effect that the catalogue does not have."""

import math

from lostmotion.lab import Parameter, effect


@effect(
    acts_on="joint",
    parameters={
        "tau_t": Parameter(0.1, "N m", 0.0, 5.0, meaning="friction in the tight spot"),
        "where": Parameter(0.0, "rad", -1.0, 1.0, meaning="its middle"),
        "width": Parameter(0.1, "rad", 0.01, 0.5, meaning="half its width"),
    },
)
def tight_spot(omega, theta, tau_t, where, width):
    """-tau_t sign(omega) exp(-((theta - where)/width)^2)"""
    return -tau_t * math.tanh(omega / 0.01) * math.exp(-(((theta - where) / width) ** 2))
