"""The detector's only error.  The detector uses no device and no file."""

from __future__ import annotations

__all__ = ["DetectorError"]


class DetectorError(ValueError):
    """Settings or data without a meaningful result; the message is one line for the user."""
