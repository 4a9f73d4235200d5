"""Gears to count promises over: inertia, stiffness, exponent and friction over two decades around the model's."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from bench.roc.waveforms import Gear

__all__ = ["GEARS"]


def _friction(torque: float) -> Gear:
    return Gear((("coulomb_friction.tau_c", torque),), ("coulomb_friction",))


GEARS: Mapping[str, Gear] = MappingProxyType(
    {
        "the model's (J2 2e-4, beta 20 N, n 11)": Gear(),
        "J2 2e-5 kg m²": Gear((("J2", 2e-5),)),
        "J2 2e-3 kg m²": Gear((("J2", 2e-3),)),
        "beta 2 N": Gear((("beta", 2.0),)),
        "beta 200 N": Gear((("beta", 200.0),)),
        "n 3": Gear((("n", 3.0),)),
        "n 31": Gear((("n", 31.0),)),
        "Coulomb friction 1e-4 N m": _friction(1e-4),
        "Coulomb friction 1e-3 N m": _friction(1e-3),
        "Coulomb friction 1e-2 N m": _friction(1e-2),
    }
)
"""A hand-waved joint of the model needs about 3e-3 N m to be accelerated: the largest friction is three times that."""
