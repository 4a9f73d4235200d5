"""What CANopen's frames are, by their COB-IDs, and the states of a node (CiA 301).  No I/O, no clock.

SDOs are in ``sdo.py``, PDOs in ``pdo.py``, drives in ``cia402.py``.
"""

from __future__ import annotations

__all__ = [
    "BOOT_UP",
    "EMCY",
    "HEARTBEAT",
    "NMT",
    "NODE_IDS",
    "OPERATIONAL",
    "PRE_OPERATIONAL",
    "RPDO1",
    "STOPPED",
    "SYNC",
    "TPDO1",
    "TPDO2",
]

NMT, SYNC, EMCY, TPDO1, RPDO1, TPDO2, HEARTBEAT = 0x000, 0x080, 0x080, 0x180, 0x200, 0x280, 0x700
"""The predefined connection set; the number of the node is added to all but NMT and SYNC."""
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
"""States as a heartbeat tells them."""
NODE_IDS = range(1, 128)
