"""The physics: bases, effects, the compiled integrator, motions, the sensor.  No I/O, no clock, nothing else of ours.

>>> trajectory = build_model("play", ["coulomb_friction"], {"d": 6e-5}).simulate(Sine(6.0, 0.02), times)
"""

from lostmotion.model.bases import BASES
from lostmotion.model.effects import EffectInfo, catalogue
from lostmotion.model.errors import ChaoticMotionWarning, ModelError
from lostmotion.model.horizon import Check, check, predictability_horizon
from lostmotion.model.model import Model, build_model
from lostmotion.model.motion import Chirp, HandWaved, Motion, Sampled, Sine, Step, by_name
from lostmotion.model.parameter import Domain, Parameter
from lostmotion.model.sensor import Sensor
from lostmotion.model.trajectory import Trajectory

__all__ = [
    "BASES",
    "ChaoticMotionWarning",
    "Check",
    "Chirp",
    "Domain",
    "EffectInfo",
    "HandWaved",
    "Model",
    "ModelError",
    "Motion",
    "Parameter",
    "Sampled",
    "Sensor",
    "Sine",
    "Step",
    "Trajectory",
    "build_model",
    "by_name",
    "catalogue",
    "check",
    "predictability_horizon",
]
