"""A lock on a file by its device and inode, so that a hard link to a database is the same database.

A lock beside the file (``database.py``) knows names only.  This one is an abstract Unix socket named by the inode: it
needs no folder, goes with its process, and does not touch the file, of which SQLite's own locks would be lost when it
is closed.  It is seen within one network namespace, on Linux; elsewhere there is none.
"""

from __future__ import annotations

import errno
import logging
import os
import socket
import struct
import sys
import time
from contextlib import suppress

__all__ = ["HeldError", "InodeLock", "is_held"]

log = logging.getLogger(__name__)

Identity = tuple[int, int]

QUEUE = 64
"""so many may ask who holds a lock between two looks of its holder"""
PAUSE_S = 0.02
"""a holder has its socket bound for a moment before it can be asked"""
UCRED = struct.Struct("iII")
"""Linux's credentials of a peer: process, user and group"""


class HeldError(Exception):
    """Another store holds the file."""


class InodeLock:
    """Holds the file of that device and inode, owned by ``owner``, until it is closed.  Raises HeldError.

    A name is free to all users of a computer: one taken by a user who could not write the file keeps nobody out.
    """

    def __init__(self, identity: Identity, owner: int) -> None:
        self.identity = identity
        self._socket = _bound(identity, owner)

    def answer(self) -> None:
        """Lets those go who have asked; called now and then."""
        with suppress(OSError):
            for _ in range(QUEUE if self._socket else 0):
                assert self._socket is not None
                self._socket.accept()[0].close()

    def close(self) -> None:
        """Lets another have the file."""
        if self._socket is not None:
            self._socket.close()


def is_held(identity: Identity, owner: int) -> bool:
    """Whether a store, of this process or another, holds the file."""
    try:
        with _socket() as asking:
            asking.connect(_name(identity))
            credentials = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, UCRED.size)
    except OSError:
        return False
    return UCRED.unpack(credentials)[1] in (0, os.geteuid(), owner)


def _bound(identity: Identity, owner: int) -> socket.socket | None:
    """The socket; None where there can be none, or where a stranger has its name."""
    if sys.platform != "linux":
        return None
    try:
        made = _socket()
    except OSError as error:
        log.warning("a hard link to the database is not noticed: %s", error.strerror)
        return None
    try:
        made.bind(_name(identity))
        made.listen(QUEUE)
    except OSError as error:
        made.close()
        for pause_s in (0.0, PAUSE_S) if error.errno == errno.EADDRINUSE else ():
            time.sleep(pause_s)
            if is_held(identity, owner):
                raise HeldError from error
        taken = "another user has taken its lock" if error.errno == errno.EADDRINUSE else error.strerror
        log.warning("a hard link to the database is not noticed: %s", taken)
        return None
    return made


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    made.setblocking(False)
    return made


def _name(identity: Identity) -> str:
    return "\0lostmotion/database/{}/{}".format(*identity)
