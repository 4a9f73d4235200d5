"""python-can without TLS and OpenSSL's hashes: 5 MB in a running service, which no bus needs.  Import it from here.

It loads its readers of log files with itself, and these load asyncio and hashlib; both do without those two libraries.
"""

from __future__ import annotations

import sys
from importlib import import_module

__all__ = ["can"]

UNUSED = ("ssl", "_hashlib")

_absent = [name for name in UNUSED if name not in sys.modules]
sys.modules.update(dict.fromkeys(_absent))  # type: ignore[arg-type]  # None: whoever imports it finds it missing
try:
    import_module("can")
finally:
    for _name in _absent:
        del sys.modules[_name]

import can  # noqa: E402
