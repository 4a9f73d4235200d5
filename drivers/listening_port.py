"""A serial port that can only be listened to: the kernel refuses every byte that would be sent."""

from __future__ import annotations

import fcntl
import os

import serial

from lostmotion.drivers.serial_port import SerialPort

__all__ = ["ListeningPort"]


class ListeningPort(SerialPort):
    """See ``SerialPort``.  RTS is let go, which enables the transmitter of some RS-485 adapters."""

    def wait(self, timeout_s: float) -> bool:
        """Whether something has come in, or the port has gone, within ``timeout_s``.  Raises PortError when closed."""
        with self._busy:
            self._fd()
            return bool(self._poll.poll(max(0.0, timeout_s * 1000)))

    def _connect(self) -> serial.Serial:
        """pyserial sets the line and opens it for both directions; its descriptor is replaced by one for reading."""
        device = serial.Serial(None, self.baudrate, timeout=0, exclusive=True)
        device.port, device.rts = self.path, False
        device.open()
        reader = os.open(self.path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            os.dup2(reader, device.fileno(), inheritable=False)  # pyserial's lock goes with its descriptor
            fcntl.flock(device.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            device.close()
            raise
        finally:
            os.close(reader)
        return device
