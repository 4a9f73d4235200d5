"""One CiA 402 drive as its frames show it: frames in, samples and its state out.  No I/O, no clock."""

from __future__ import annotations

import math
from collections.abc import Iterator

from lostmotion.drivers.base import ServoSample
from lostmotion.drivers.can_bus import CanFrame
from lostmotion.drivers.canopen_mapping import Ask, NodeFacts, Pdos, given_pdos, read_facts, read_pdos
from lostmotion.drivers.canopen_options import CanopenJointOptions
from lostmotion.drivers.codec import cia402
from lostmotion.drivers.codec.cia301 import BOOT_UP, EMCY, HEARTBEAT, OPERATIONAL, PRE_OPERATIONAL, STOPPED
from lostmotion.drivers.codec.pdo import Field, Object, PdoError, fields_of, value_of
from lostmotion.drivers.errors import DriverError

__all__ = ["Drive"]

STATES = {BOOT_UP: "initialising", STOPPED: "stopped", PRE_OPERATIONAL: "pre-operational"}
WANTED = (
    cia402.STATUSWORD, cia402.DEMAND, cia402.POSITION, cia402.VELOCITY, cia402.TORQUE, cia402.CURRENT, cia402.DC_LINK,
    cia402.TARGET,
)  # fmt: skip
COMMANDS = {"demand": (cia402.DEMAND,), "target": (cia402.TARGET,), "auto": (cia402.DEMAND, cia402.TARGET)}
LONGEST_GAP_S = 1.0
"""a longer gap counts as a silent drive, not as lost polls"""


class Drive:
    """The state of node ``options.node``.  A sample has the time of the frame that brought the position; the other
    values are the newest since the sample before.  The command counts until another one comes, since the drive keeps
    it; while the drive is not in Operation enabled it follows none, and there is no sample."""

    def __init__(self, options: CanopenJointOptions) -> None:
        """Raises DriverError for a mapping without a position or a command, or units that are not given."""
        self.options = options
        self.joint = options.name
        self.node = options.node
        self.last_seen = -math.inf  # when the last position came [s]
        self.lost = 0  # polls, since it was set to 0
        self.facts: NodeFacts | None = None
        self.units: cia402.Units | None = None
        self.fields: dict[int, list[tuple[Object, Field]]] = {}
        self._command: Object = cia402.TARGET
        self._asked = False
        self._pdos = given_pdos(options)
        if self._pdos is None and not options.sdo:
            raise DriverError(
                f"joint {self.joint}: no PDO mapping; expected pdo = [...], eds = a file, or sdo = true, which lets it "
                f"be read from node {self.node}"
            )
        self.forget()
        if self._pdos is not None:
            self._map(self._pdos)
        if not options.sdo:
            self._scale(None)

    def forget(self) -> None:
        """Drops what came so far: the bus was opened anew."""
        self.last_seen = -math.inf
        self._beat = math.nan
        self._nmt = self._error = None
        self._fresh: dict[Object, int] = {}
        self._goal: int | None = None
        self._state = ""
        self._asked = False

    _nmt: int | None
    _error: int | None

    @property
    def ids(self) -> frozenset[int]:
        """The identifiers of its frames."""
        return frozenset((*self.fields, EMCY + self.node, HEARTBEAT + self.node))

    @property
    def where(self) -> str:
        """Which PDOs hold position and command."""
        found = {object: id for id, fields in self.fields.items() for object, _ in fields}
        if not found:
            return "the position of a CiA 402 drive"
        return (
            f"position in 0x{found[cia402.POSITION]:X}, command (0x{self._command[0]:X}) in 0x{found[self._command]:X}"
        )

    @property
    def complete(self) -> bool:
        """Whether position and command have come."""
        return self.last_seen > -math.inf and self._goal is not None

    def learn(self, ask: Ask) -> str:
        """Reads by SDO what is not given, once for each opening of the bus; why that is of no use, "" if it is."""
        if self._asked:
            return ""
        facts = read_facts(ask)
        if facts.device_type is None:
            return "no answer to an SDO"
        if facts.device_type & 0xFFFF != cia402.PROFILE:
            return f"a device of profile CiA {facts.device_type & 0xFFFF}, no drive"
        try:
            self._map(self._pdos if self._pdos is not None else read_pdos(ask))
            self._scale(facts)
        except (DriverError, PdoError) as error:
            return str(error)
        self.facts, self._asked = facts, True
        return ""

    def take(self, frame: CanFrame) -> Iterator[ServoSample]:
        """What a frame of this drive brings."""
        fields = self.fields.get(frame.id)
        if fields is None:
            self._service(frame)
            return
        number, size, fresh = int.from_bytes(frame.data, "little"), len(frame.data), self._fresh
        for known, field in fields:
            if field.ends <= size:
                fresh[known] = value_of(field, number)
        self._goal = fresh.pop(self._command, self._goal)
        if (word := fresh.pop(cia402.STATUSWORD, None)) is not None:
            self._state = cia402.state_of(word)
        if cia402.POSITION in fresh:
            sample = self._sample(frame.time)
            if sample is not None:
                yield sample

    def problem(self, now: float) -> str:
        """Why there can be no samples, "" for no reason: from the state that the node itself sends."""
        if now - self._beat > self.options.heartbeat_s:  # NaN compares false: it sends none
            return f"no heartbeat for more than {self.options.heartbeat_s:g} s; likely cause: off, or unplugged"
        if self._nmt is not None and self._nmt != OPERATIONAL:
            state = STATES.get(self._nmt, f"NMT state {self._nmt}")
            return f"{state}, sends no PDOs; likely cause: the master has not started it"
        if self._state and self._state != cia402.OPERATION_ENABLED:
            error = f", error 0x{self._error:04X}" if self._error else ""
            return f"{self._state}{error}, follows no command; likely cause: the master has not enabled it"
        return ""

    def _service(self, frame: CanFrame) -> None:
        if frame.id == HEARTBEAT + self.node and len(frame.data) == 1:
            self._beat, self._nmt = frame.time, frame.data[0] & 0x7F
        elif frame.id == EMCY + self.node and len(frame.data) >= 2:
            self._error = int.from_bytes(frame.data[:2], "little")

    def _sample(self, time: float) -> ServoSample | None:
        fresh, units, before = self._fresh, self.units, self.last_seen
        position = fresh.pop(cia402.POSITION)
        self.last_seen, self._fresh = max(time, before), {}
        if 0 < (gap := time - before) < LONGEST_GAP_S:
            self.lost += max(0, round(gap * self.options.poll_hz) - 1)
        if units is None or self._goal is None or time <= before or self._state not in ("", cia402.OPERATION_ENABLED):
            return None
        step, unknown = units.step, math.nan
        return ServoSample(
            self.joint,
            time,
            self._goal * step,
            position * step,
            fresh[cia402.VELOCITY] * units.speed if cia402.VELOCITY in fresh else unknown,
            fresh[cia402.TORQUE] * units.torque if cia402.TORQUE in fresh else unknown,
            fresh[cia402.CURRENT] * units.current if cia402.CURRENT in fresh else unknown,
            fresh[cia402.DC_LINK] / 1000 if cia402.DC_LINK in fresh else unknown,
        )

    def _map(self, pdos: Pdos) -> None:
        fields = {}
        for id, entries in pdos.items():
            kept = [(known, field) for known, field in fields_of(entries, cia402.SIGNED).items() if known in WANTED]
            if kept:
                fields[id] = kept
        there = {known for kept in fields.values() for known, _ in kept}
        commands = [known for known in COMMANDS[self.options.command] if known in there]
        if cia402.POSITION not in there or not commands:
            lacking = "position actual value 0x6064" if cia402.POSITION not in there else "command, 0x607A or 0x6062"
            raise DriverError(f"joint {self.joint}: no PDO of node {self.node} holds the {lacking}")
        self.fields, self._command = fields, commands[0]

    def _scale(self, facts: NodeFacts | None) -> None:
        given = self.options
        counts = given.counts_per_turn or (facts and facts.resolution)
        if not counts or given.gear_ratio == 0:
            key = "gear_ratio, other than 0" if counts else "counts_per_turn"
            raise DriverError(
                f"joint {self.joint}: {key} is missing, and the node does not report it; expected it in the file"
            )
        ratio = given.gear_ratio or (facts and facts.ratio) or 1.0
        torque = given.rated_torque_nm or (facts and facts.rated_torque_nm) or math.nan
        current = given.rated_current_a or (facts and facts.rated_current_a) or math.nan
        self.units = cia402.Units(counts, ratio, given.velocity_unit, torque, current)
