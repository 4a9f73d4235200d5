"""python-can without TLS and OpenSSL's hashes: 4 MB in a running service, which no bus needs.  Import it from here.

It loads its readers of log files with itself, and these load asyncio and hashlib, which do without those two libraries
as on a Python that was built without them.  Where another package has a driver or a sink, which may need them, they
stay.  docs/decisions/0011-dependencies.md has the reasons.
"""

from __future__ import annotations

import logging
import sys
import termios
from importlib import import_module

from lostmotion.drivers import plugins

__all__ = ["FAULTS", "can"]

UNUSED = ("ssl", "_hashlib")
GROUPS = ("lostmotion.drivers", "lostmotion.sinks")

_hidden = [] if any(map(plugins.targets, GROUPS)) else [name for name in UNUSED if name not in sys.modules]
sys.modules.update(dict.fromkeys(_hidden))  # type: ignore[arg-type]  # None: whoever imports it finds it missing
try:
    import_module("can")
finally:
    for _name in _hidden:
        del sys.modules[_name]

import can  # noqa: E402

logging.getLogger("can").setLevel(logging.CRITICAL)  # its messages are replaced by ours
FAULTS = (can.CanError, OSError, ValueError, TypeError, termios.error)
"""What python-can's interfaces raise for a bus that is not there, or not as it should be."""
