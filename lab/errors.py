"""The lab's exceptions, which extend the tree in drivers/errors.py.

LostmotionError
├── ModelFileError           a model file that cannot be read or makes no sense
├── SimulationError          the requested simulation is impossible
├── ExperimentError          a recording that this model cannot be compared with
├── EffectFileError          a file with a user-defined effect that cannot be used
└── ExecutorError            an executor that cannot be opened
"""

from __future__ import annotations

from lostmotion.drivers.errors import LostmotionError

__all__ = ["EffectFileError", "ExecutorError", "ExperimentError", "ModelFileError", "SimulationError"]


class ModelFileError(LostmotionError):
    """The model file is wrong; one line says where, what was found and what was expected."""


class SimulationError(LostmotionError):
    """The requested simulation is impossible; one line says why."""


class ExperimentError(LostmotionError):
    """The recording cannot be compared with the model; one line says what was found and what the base needs."""


class EffectFileError(LostmotionError):
    """The user-defined effect cannot be used; one line says where and why."""


class ExecutorError(LostmotionError):
    """The executor cannot be opened; one line says what is missing."""
