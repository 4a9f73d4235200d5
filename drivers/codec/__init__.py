"""Bytes ↔ packets, and raw counts ↔ SI units.  No I/O and no clock: bytes in, values out, and back."""
