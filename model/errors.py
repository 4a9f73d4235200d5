"""What can be wrong with a model, its parameters, its input or a simulation.  Nothing else lives here."""

from __future__ import annotations

__all__ = ["ChaoticMotionWarning", "ModelError"]


class ModelError(ValueError):
    """A model, parameter, motion or state that makes no physical sense; the message is one line for a person."""


class ChaoticMotionWarning(UserWarning):
    """The motion depends on its start so strongly that samples beyond the horizon mean nothing one by one."""
