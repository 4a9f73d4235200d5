"""What signals have asked of the service; what becomes of it is decided elsewhere."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["Flags"]


class Flags:
    """Set by signals: ``stop`` by SIGTERM and SIGINT, ``reload`` by SIGHUP."""

    def __init__(self) -> None:
        self.stop = False
        self.reload = False

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Listens to the signals, and gives them back afterwards."""
        numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        before = {number: signal.signal(number, self._set) for number in numbers}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _set(self, number: int, frame: FrameType | None) -> None:
        self.reload = self.reload or number == signal.SIGHUP
        self.stop = self.stop or number != signal.SIGHUP
