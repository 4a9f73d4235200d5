"""What the detector refuses.  It knows no device and no file, so its one error stands alone."""

from __future__ import annotations

__all__ = ["DetectorError"]


class DetectorError(ValueError):
    """Settings or data that cannot give a meaningful answer; the one-line message is meant for a person."""
