"""Finds a node's PDO mapping: from the configuration, an EDS or DCF file, or the node itself by SDO.

All of it is read, nothing written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from lostmotion.drivers.canopen_options import CanopenJointOptions, CanopenSensorOptions
from lostmotion.drivers.codec.pdo import PdoError, fields_of
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.packages import is_there, missing

__all__ = ["Ask", "NodeFacts", "Pdos", "given_pdos", "read_facts", "read_pdos"]

Ask = Callable[[int, int], int | None]
"""an object's unsigned value by index and subindex; None where the node has none"""
Pdos = Mapping[int, Sequence[int]]
"""mapping parameters by COB-ID"""
COMMUNICATION, MAPPING = (0x1400, 0x1800), (0x1600, 0x1A00)
"""of RPDOs, of TPDOs"""
PROBED = 8
"""PDOs of each kind that a node is asked for"""
IN_A_FILE = 512
INVALID = 1 << 31
COB_ID_BITS = 0x7FF


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """The identity objects of a node; None where it has no such object."""

    device_type: int | None
    vendor: int | None
    product: int | None
    resolution: float | None
    ratio: float | None
    rated_torque_nm: float | None
    rated_current_a: float | None


def given_pdos(options: CanopenJointOptions | CanopenSensorOptions) -> Pdos | None:
    """The mapping as the configuration or its file gives it; None where it gives none.  Raises DriverError."""
    if options.pdo:
        found: Pdos = {pdo.cob_id: tuple(pdo.map) for pdo in options.pdo}
    elif options.eds:
        found = _file_pdos(options.name, options.eds, options.node)
    else:
        return None
    try:
        for entries in found.values():
            fields_of(entries, ())
    except PdoError as error:
        raise DriverError(f"{options.name}: the PDO mapping: {error}") from error
    return found


def read_pdos(ask: Ask, most: int = PROBED) -> Pdos:
    """The mapping from the node's objects."""
    found: dict[int, Sequence[int]] = {}
    for communication, mapping in zip(COMMUNICATION, MAPPING, strict=True):
        for number in range(most):
            cob_id = ask(communication + number, 1)
            if cob_id is None or cob_id & INVALID:
                continue
            count = ask(mapping + number, 0) or 0
            entries = [ask(mapping + number, sub + 1) for sub in range(min(count, 64))]
            found[cob_id & COB_ID_BITS] = [entry for entry in entries if entry]
    return found


def read_facts(ask: Ask) -> NodeFacts:
    """Identity, resolution and ratings."""
    torque, current = ask(0x6076, 0), ask(0x6075, 0)
    return NodeFacts(
        ask(0x1000, 0),
        ask(0x1018, 1),
        ask(0x1018, 2),
        _quotient(ask(0x608F, 1), ask(0x608F, 2)),
        _quotient(ask(0x6091, 1), ask(0x6091, 2)),
        None if torque is None else torque / 1000,
        None if current is None else current / 1000,
    )


def _quotient(above: int | None, below: int | None) -> float | None:
    return above / below if above and below else None


def _file_pdos(name: str, path: str, node: int) -> Pdos:
    if not is_there("canopen"):
        raise DriverError(f"{name}.eds: {missing('canopen', 'an EDS file')}")
    import canopen  # only to read the file; the bus does without

    try:
        objects = canopen.import_od(path, node_id=node)
    except Exception as error:
        raise DriverError(f"{name}.eds: {path} cannot be read as EDS or DCF: {error!s:.120}") from error

    def ask(index: int, subindex: int) -> int | None:
        try:
            entry = objects.get_variable(index, subindex)
        except KeyError:
            return None
        if entry is None:
            return None
        value = entry.default if entry.value is None else entry.value
        return value if isinstance(value, int) else None

    found = read_pdos(ask, IN_A_FILE)
    if not found:
        raise DriverError(
            f"{name}.eds: {path} maps no PDO; expected a DCF of the drive as it is set up, or pdo = [...]"
        )
    return found
