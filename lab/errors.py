"""What can be wrong with the lab's input, on top of the tree in drivers/errors.py.

LostmotionError
├── ModelFileError           a model file that cannot be read or makes no sense
└── SimulationError          what is asked of the model cannot be simulated
"""

from __future__ import annotations

from lostmotion.drivers.errors import LostmotionError

__all__ = ["ModelFileError", "SimulationError"]


class ModelFileError(LostmotionError):
    """The model file is wrong; one line says where, what was found and what was expected."""


class SimulationError(LostmotionError):
    """What is asked of the model cannot be simulated; one line says why."""
