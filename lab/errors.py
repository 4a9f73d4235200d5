"""What can be wrong with the lab's input, on top of the tree in drivers/errors.py.

LostmotionError
├── ModelFileError           a model file that cannot be read or makes no sense
├── SimulationError          what is asked of the model cannot be simulated
├── ExperimentError          a recording that this model cannot be held against
├── EffectFileError          a file with an effect of the user's own that cannot be used
└── ExecutorError            where parallel work is to run, and cannot
"""

from __future__ import annotations

from lostmotion.drivers.errors import LostmotionError

__all__ = ["EffectFileError", "ExecutorError", "ExperimentError", "ModelFileError", "SimulationError"]


class ModelFileError(LostmotionError):
    """The model file is wrong; one line says where, what was found and what was expected."""


class SimulationError(LostmotionError):
    """What is asked of the model cannot be simulated; one line says why."""


class ExperimentError(LostmotionError):
    """The recording cannot be held against the model; one line says what was found and what the base needs."""


class EffectFileError(LostmotionError):
    """The user's own effect cannot be used; one line says where and why."""


class ExecutorError(LostmotionError):
    """Parallel work cannot run where it was asked to; one line says what is missing."""
