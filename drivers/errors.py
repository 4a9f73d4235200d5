"""The exceptions of drivers, as one tree.

LostmotionError
└── DriverError              every message has what was found, what was expected and the likely cause
    ├── PortError            the port is missing, busy, or went away            (worth another try later)
    ├── IdentityError        another device answers on the port                 (wants a person)
    ├── UnknownDriverError   no driver of that name is installed
    └── RecordingError       a recording that cannot be read or is not one
EndOfData                    a replay has come to its end: no error, and no LostmotionError
"""

from __future__ import annotations

import os

__all__ = [
    "DriverError",
    "EndOfData",
    "IdentityError",
    "LostmotionError",
    "PortError",
    "RecordingError",
    "UnknownDriverError",
    "unreadable",
    "unwritable",
]


class LostmotionError(Exception):
    """Any error whose one-line message is meant for a person; the command line prints it and exits with status 2."""


class DriverError(LostmotionError):
    """Something is wrong with a device, its port or its data."""


class PortError(DriverError):
    """The port is missing, busy, or went away; the service tries again."""


class IdentityError(DriverError):
    """A device answers, but it is not the one the configuration names."""


class UnknownDriverError(DriverError):
    """No driver of that name is in the table or among the entry points."""


class RecordingError(DriverError):
    """The file is no recording, or one that cannot be used."""


class EndOfData(Exception):  # noqa: N818 - an ending, not an error
    """The driver has handed out all there is and never will have more (a replay at its end)."""


def unreadable(path: object, error: OSError) -> str:
    """One line for a file that cannot be read."""
    cause = "may this user read it?" if isinstance(error, PermissionError) else "is the path right?"
    return f"{path}: cannot be read: {error.strerror or error}; {cause}"


def unwritable(path: object, error: OSError) -> str:
    """One line for a file that cannot be written."""
    reason = os.strerror(error.errno) if error.errno else error  # a library may have put a page into strerror
    return f"{path}: cannot be written: {reason}; is there a folder, and room?"
