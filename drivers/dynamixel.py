"""Driver of ROBOTIS Dynamixel servos: AX and MX on protocol 1.0, X and MX on protocol 2.0, also mixed on one line.

It only reads; it never moves a servo.  The port stands in ``dynamixel_port.py``, models and units in
``codec/servo_state.py``.  Packets are made and checked by dynamixel-sdk, but for the one question that is put to each
servo of protocol 1.0 at every poll: a sync read, which 1.0 has not, would ask all at once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from lostmotion.drivers.base import (
    Baudrate,
    Driver,
    Identity,
    JointOptions,
    Port,
    RobotOptions,
    ServoBus,
    ServoReading,
    ServoSample,
)
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec.dynamixel import Question
from lostmotion.drivers.codec.servo_state import ADDRESS, MODELS, Model, decode_state, model_name
from lostmotion.drivers.dynamixel_port import BusPort
from lostmotion.drivers.errors import DriverError

__all__ = ["DRIVER", "DynamixelOptions"]

LONGEST_WAIT_S = 0.3
GATHER_S = 0.095
"""the answers of so many seconds are looked at together: right after a wait, with cold caches, that costs far more; a
reversal is usually certain 0.11 s before the end of its window"""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 2.0
"""a silent servo costs 34 ms each time it is asked, so the pause before the next time doubles from one to the other"""
EAVESDROP_S = 1.2
"""a GPS receiver speaks once a second"""
MAX_ID = 252
PACKET_ID, PACKET_DATA = 4, 9
"""where the SDK's list of a status packet of protocol 2.0 holds them"""


class DynamixelOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """baudrate [bit/s] of the line; model: as printed on the servo; id: the servo's number on the line."""

    port: Port
    baudrate: Baudrate = 1_000_000
    model: str
    id: int


@dataclass(slots=True, eq=False)
class _Servo:
    """One servo on the line; one that is silent rests until a time [s], and then for twice that ``pause`` [s]."""

    joint: str
    id: int
    model: Model
    question: Question | None
    """the plain question of protocol 1.0"""
    pause: float = 0.0
    rests_until: float = 0.0


@dataclass(slots=True)
class _Group:
    """Servos of one protocol that are asked together, every ``period`` [s], and when next [s]."""

    servos: list[_Servo]
    period: float
    questions: list[Question]
    """the plain ones of protocol 1.0, in the order of the servos; none for 2.0"""
    due: float = 0.0

    def advance(self, now: float) -> int:
        """Sets the next turn, on the grid of the period; how many turns went by meanwhile."""
        self.due += self.period
        late = int((now - self.due) / self.period) + 1 if self.due <= now else 0
        self.due += late * self.period
        return late


_Said = tuple[_Servo, tuple[float, bytes]]
"""a servo, the robot time [s] of its request, and its state block, or the answer to its plain question as it came"""


class DynamixelBus:
    """All Dynamixel servos on one port; see ``base.ServoBus``.

    Servos are asked at multiples of their poll period.  Those of protocol 1.0 are read one by one, those of 2.0 by one
    sync read; whoever is missing in its answer is asked once more alone, because one silent servo keeps those after it
    from answering.  A sample's time is that of its request, which a servo obeys within its return delay (0.5 ms as
    shipped); the answer's may be 16 ms later.
    """

    def __init__(self, joints: Sequence[DynamixelOptions], clock: Clock) -> None:
        """Raises DriverError for an unknown model, an id used twice or different baud rates."""
        _check(joints)
        self._clock = clock
        self._servos = [_Servo(j.name, j.id, MODELS[j.model], _question(j)) for j in joints]
        alike: dict[tuple[float, int], list[_Servo]] = {}
        for joint, servo in zip(joints, self._servos, strict=True):
            alike.setdefault((joint.poll_hz, servo.model.protocol), []).append(servo)
        self._groups = [_Group(servos, 1 / rate, _questions(servos)) for (rate, _), servos in alike.items()]
        self._port = BusPort(joints[0].port, joints[0].baudrate)
        self._handlers = {1: Protocol1PacketHandler(), 2: Protocol2PacketHandler()}
        self.resolution_rad = max(servo.model.step for servo in self._servos)
        self._awake = 0.0  # from then on no servo rests [s]

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        self._port.open()
        self._start()

    def identify(self) -> tuple[Identity, ...]:
        """Asks each servo for its model number.  Raises PortError."""
        found = [self._ping(servo) for servo in self._servos]
        silence, gist = "no answer; likely cause: no power, another id, or another baudrate", ""
        if all(number is None for number, _ in found):
            heard = self._port.listen(EAVESDROP_S)
            if heard:
                told = "no answer, but {} unasked; likely cause: another device on the port"
                silence, gist = told.format(repr(heard[:24])), told.format("bytes")
        self._start()
        return tuple(
            Identity(
                servo.joint,
                silence if number is None else f"id {servo.id}: {model_name(number)}, protocol {protocol}.0",
                f"id {servo.id}: {model_name(servo.model.number)}, protocol {servo.model.protocol}.0",
                number == servo.model.number and protocol == servo.model.protocol,
                gist if number is None else "",
            )
            for servo, (number, protocol) in zip(self._servos, found, strict=True)
        )

    def read(self) -> ServoReading:
        """Waits for the next poll, at most 0.3 s; what the servos said in this poll and in those of the next 95 ms.

        Raises PortError.
        """
        turn = min(group.due for group in self._groups)
        if turn - self._clock.now() > LONGEST_WAIT_S:
            time.sleep(LONGEST_WAIT_S)
            return ServoReading(silent=self._silent())
        told: list[_Said] = []
        lost, end = 0, turn + GATHER_S
        while turn < end:
            time.sleep(max(0.0, turn - self._clock.now()))
            missed, turn = self._poll(told)
            lost += missed
        return ServoReading(tuple(self._samples(told)), self._silent(), lost)

    def close(self) -> None:
        """Gives the port back."""
        self._port.close()

    def _start(self) -> None:
        for group in self._groups:
            group.due = self._clock.now()
        for servo in self._servos:
            servo.rests_until = servo.pause = 0.0
        self._awake = 0.0

    def _ping(self, servo: _Servo) -> tuple[int | None, int]:
        """The model number that answers at this id and the protocol it speaks, its own one first."""
        own = servo.model.protocol
        for protocol in (own, 3 - own):
            number, result, _ = self._handlers[protocol].ping(self._port, servo.id)
            if result == COMM_SUCCESS:
                return number, protocol
        return None, own

    def _samples(self, told: Iterable[_Said]) -> Iterator[ServoSample]:
        """What servos have told, in SI units; an answer with a wrong checksum makes its servo a silent one."""
        for servo, (asked, block) in told:
            if servo.question and len(block) == servo.question.length:
                block = servo.question.parameters(block)
            self._note(servo, asked, bool(block))
            if block:
                command, position, velocity, voltage, heat, current = decode_state(servo.model, block)
                yield ServoSample(servo.joint, asked, command, position, velocity, math.nan, current, voltage, heat)

    def _poll(self, told: list[_Said]) -> tuple[int, float]:
        """Asks the servos whose turn it is; how many polls went by meanwhile, and when the next turn is [s].

        Few calls, because they come right after a wait: each costs ten times as much there as at other times.
        """
        now, lost, turn = self._clock.now(), 0, math.inf
        for group in self._groups:
            if group.due <= now:
                asked, questions = group.servos, group.questions
                if now < self._awake:
                    asked = [servo for servo in asked if servo.rests_until <= now]
                    questions = _questions(asked)
                if group.questions:
                    self._read_in_turn(asked, questions, told)
                else:
                    self._read_group(asked, told)
                lost += group.advance(self._clock.now()) * len(asked)
            turn = min(turn, group.due)
        return lost, turn

    def _read_in_turn(self, servos: list[_Servo], questions: list[Question], told: list[_Said]) -> None:
        """Asks servos of protocol 1.0 one after the other, whose answers are all of one length.

        Those that look like answers are kept as they are: to look into them at once, after a wait, takes ten times as
        long as to look into all of a reading.
        """
        while servos:
            answers, good = self._port.ask(questions, self._clock.now)
            told.extend(zip(servos, answers, strict=False))
            if good:
                return
            servo, (asked, answer) = told.pop()
            self._take(servo, asked, self._search(servo, questions[0].length, answer), told)
            servos, questions = servos[len(answers) :], questions[len(answers) :]

    def _search(self, servo: _Servo, length: int, answer: bytes) -> Sequence[int]:
        """A servo's state block where its plain answer did not come: the SDK finds it among noise or in pieces."""
        if not answer or len(answer) == length:
            self._port.clearPort()
            return b""
        data: Sequence[int]
        data, _, _ = self._handlers[1].readRx(self._port, servo.id, servo.model.block_size)
        return data

    def _read_one(self, servo: _Servo, told: list[_Said]) -> None:
        now = self._clock.now()
        data, _, _ = self._handlers[2].readTxRx(self._port, servo.id, ADDRESS[2], servo.model.block_size)
        self._take(servo, now, data, told)

    def _read_group(self, servos: list[_Servo], told: list[_Said]) -> None:
        """One sync read of servos of protocol 2.0; those that were silent before, or are now, are asked alone.

        The SDK's group reader is no use: with one silent servo it gives 0 for all, without error.
        """
        lone = [servo for servo in servos if servo.pause]
        missing = {servo.id: servo for servo in servos if not servo.pause}
        if missing:
            self._sync_read(missing, told)
        for servo in (*missing.values(), *lone):
            self._read_one(servo, told)

    def _sync_read(self, missing: dict[int, _Servo], told: list[_Said]) -> None:
        """Takes those out of ``missing`` that answer."""
        servos = list(missing.values())
        handler, now, size = self._handlers[2], self._clock.now(), servos[0].model.block_size
        handler.syncReadTx(self._port, ADDRESS[2], size, list(missing), len(missing), False)
        for _ in servos:
            packet, result = handler.rxPacket(self._port, False)
            if result == COMM_RX_TIMEOUT:
                break
            if result == COMM_SUCCESS and (servo := missing.pop(packet[PACKET_ID], None)):
                self._take(servo, now, packet[PACKET_DATA : PACKET_DATA + size], told)

    def _take(self, servo: _Servo, asked: float, data: Sequence[int], told: list[_Said]) -> None:
        """Keeps a state block; one that is missing or of another size makes the servo a silent one."""
        good = len(data) == servo.model.block_size
        self._note(servo, asked, good)
        if good:
            told.append((servo, (asked, bytes(data))))

    def _note(self, servo: _Servo, asked: float, good: bool) -> None:
        """Takes down whether a servo has answered; what it was asked before its last rest says nothing new."""
        if asked < servo.rests_until:
            return
        servo.pause = 0.0 if good else min(2 * servo.pause, LONGEST_PAUSE_S) or FIRST_PAUSE_S
        if not good:
            servo.rests_until = self._clock.now() + servo.pause
            self._awake = max(self._awake, servo.rests_until)

    def _silent(self) -> tuple[str, ...]:
        return tuple(servo.joint for servo in self._servos if servo.pause)


def _question(joint: DynamixelOptions) -> Question | None:
    model = MODELS[joint.model]
    return Question(joint.id, ADDRESS[1], model.block_size) if model.protocol == 1 else None


def _questions(servos: Iterable[_Servo]) -> list[Question]:
    return [servo.question for servo in servos if servo.question]


def _check(joints: Sequence[DynamixelOptions]) -> None:
    seen: dict[int, str] = {}
    for joint in joints:
        if joint.model not in MODELS:
            raise DriverError(f"joint {joint.name}: no model {joint.model!r} is known; there are {', '.join(MODELS)}")
        if not 0 <= joint.id <= MAX_ID:
            raise DriverError(f"joint {joint.name}: id is {joint.id}; expected 0 to {MAX_ID}")
        if joint.poll_hz <= 0:
            raise DriverError(f"joint {joint.name}: poll_hz is {joint.poll_hz:g}; expected more than 0")
        if joint.id in seen:
            raise DriverError(f"joints {seen[joint.id]} and {joint.name} have the same id {joint.id} on {joint.port}")
        seen[joint.id] = joint.name
    rates = sorted({joint.baudrate for joint in joints})
    if len(rates) > 1:
        raise DriverError(f"port {joints[0].port}: one line has one baudrate, found {', '.join(map(str, rates))}")


def _make(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    return DynamixelBus([joint for joint in joints if isinstance(joint, DynamixelOptions)], clock)


DRIVER = Driver(
    name="dynamixel",
    summary="ROBOTIS Dynamixel AX, MX (protocol 1.0 and 2.0) and X series",
    servo=_make,
    joint_options=DynamixelOptions,
)
