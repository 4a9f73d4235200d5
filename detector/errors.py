"""The detector's only error.  The detector uses no device and no file."""

from __future__ import annotations

__all__ = ["DetectorError"]


class DetectorError(ValueError):
    """Settings or data that cannot give a meaningful answer; the one-line message is meant for a person."""
