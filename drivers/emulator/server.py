"""Devices on pseudo-terminals: one thread waits for all of them.  Each device makes its own bytes."""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

__all__ = ["Device", "Emulator"]

IDLE_S = 1.0


class Device(Protocol):
    """A device as bytes and times [s] on the host's monotonic clock."""

    def receive(self, data: bytes, now: float) -> None:
        """Takes bytes that the host sent."""
        ...

    def due(self) -> float:
        """When it wants to send next; inf: only when asked."""
        ...

    def emit(self, now: float) -> bytes:
        """The bytes that it sends now."""
        ...


class _Plug:
    """A device and the pseudo-terminal it is plugged into, if any."""

    def __init__(self, device: Device, link: Path | None, baudrate: int | None) -> None:
        self.device = device
        self.link = link
        self._speed = None if baudrate is None else getattr(termios, f"B{baudrate}")
        self.path = ""
        self.master = self.slave = -1

    def plug(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)
        if self.link is not None:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.path)
            self.path = str(self.link)

    def unplug(self) -> None:
        if self.master < 0:
            return
        if self.link is not None:
            self.link.unlink(missing_ok=True)
        os.close(self.slave)
        os.close(self.master)
        self.master = self.slave = -1

    def receive(self, now: float) -> None:
        with contextlib.suppress(BlockingIOError):
            data = os.read(self.master, 4096)
            self.device.receive(data if self._in_tune() else _noise(data), now)

    def send(self, now: float) -> None:
        data = self.device.emit(now)
        if data:
            data = data if self._in_tune() else _noise(data)
            # a full buffer: nobody reads, and as on a real line the bytes are lost
            with contextlib.suppress(BlockingIOError):
                os.write(self.master, data)

    def _in_tune(self) -> bool:
        """Whether the host has set the device's baud rate; a pseudo-terminal itself does not care."""
        return self._speed is None or termios.tcgetattr(self.slave)[5] == self._speed

    def release(self) -> None:
        """A pseudo-terminal keeps the exclusive flag of a program that was killed; a real port drops it."""
        fcntl.ioctl(self.slave, termios.TIOCNXCL)


def _noise(data: bytes) -> bytes:
    """What a line at another baud rate makes of bytes: as many, of other values."""
    return bytes((byte * 173 + 91) % 256 for byte in data)


class Emulator:
    """Serves devices, each on a pseudo-terminal of its own, until the ``with`` block ends.

    ``link`` makes symbolic links that survive unplugging and plugging in again: link.0, link.1, …  With a ``baudrate``,
    one that termios knows, whoever opens a port at another one gets noise, and is not understood.
    """

    def __init__(self, *devices: Device, link: Path | None = None, baudrate: int | None = None) -> None:
        links = [link.with_name(f"{link.name}.{i}") if link else None for i in range(len(devices))]
        self._plugs = [_Plug(device, link, baudrate) for device, link in zip(devices, links, strict=True)]
        self._wake_read, self._wake_write = os.pipe()
        self._orders: list[tuple[Callable[[], object], threading.Event]] = []
        self._stop = False
        self._thread = threading.Thread(target=self._serve, name="emulator", daemon=True)

    def __enter__(self) -> Emulator:
        for plug in self._plugs:
            plug.plug()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        for index in range(len(self._plugs)):
            self.unplug(index)
        self.order(self._halt)
        self._thread.join()
        os.close(self._wake_read)
        os.close(self._wake_write)

    @property
    def paths(self) -> tuple[str, ...]:
        """The ports of the devices, in order."""
        return tuple(plug.path for plug in self._plugs)

    def unplug(self, index: int = 0) -> None:
        """Pulls the plug: whoever has the port open gets an error, and its link is gone."""
        self.order(self._plugs[index].unplug)

    def plug(self, index: int = 0) -> None:
        """Plugs the device in again: at the same path when there is a link."""
        self.order(self._plugs[index].plug)

    def order(self, action: Callable[[], object]) -> None:
        """Lets the serving thread do something between bytes: it may be waiting for the descriptors concerned."""
        done = threading.Event()
        self._orders.append((action, done))
        os.write(self._wake_write, b".")
        done.wait()

    def _serve(self) -> None:
        released = 0.0
        while not self._stop:
            plugs = {plug.master: plug for plug in self._plugs if plug.master >= 0}
            now = time.monotonic()
            due = min((plug.device.due() for plug in plugs.values()), default=math.inf)
            ready, _, _ = select.select([self._wake_read, *plugs], [], [], max(0.0, min(IDLE_S, due - now)))
            now = time.monotonic()
            if self._wake_read in ready:
                self._obey()
                continue
            for fd in ready:
                plugs[fd].receive(now)
            for plug in plugs.values():
                if plug.device.due() <= now:
                    plug.send(now)
            if now > released + IDLE_S:
                released = now
                for plug in plugs.values():
                    plug.release()

    def _obey(self) -> None:
        os.read(self._wake_read, 1)
        action, done = self._orders.pop(0)
        action()
        done.set()

    def _halt(self) -> None:
        self._stop = True
