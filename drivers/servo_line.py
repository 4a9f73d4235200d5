"""Servos on one half-duplex line that are polled: who is asked when and together, who is silent, and who rests.

Every driver of such servos is a subclass, which knows the bytes: how a servo is asked, and what its answer means.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle

from lostmotion.drivers.base import Baudrate, Identity, JointOptions, Port, ServoReading, ServoSample
from lostmotion.drivers.clock import Clock, next_cycle
from lostmotion.drivers.codec.dynamixel import Question
from lostmotion.drivers.codec.servo_state import Model
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.servo_port import ServoPort
from lostmotion.drivers.textfile import near

__all__ = ["LineBus", "LineOptions", "Reply", "Servo", "check_line", "line_bytes", "silence_s"]

LONGEST_WAIT_S = 0.3
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 2.0
"""a silent servo costs 34 ms each time it is asked, so the pause before the next time doubles from one to the other"""
SILENT_POLLS, LEAST_SILENCE_S = 5, 0.2
"""a joint that is listened to has lost so many polls, and as long as two gathered readings take, before it is silent"""
EAVESDROP_S = 1.2
"""a GPS receiver speaks once a second"""
MAX_ID = 252
QUESTION_SIZE, ANSWER_SIZE = 8, {1: 6, 2: 11}
"""bytes of a read instruction of protocol 1.0, and what an answer of each protocol adds to its data"""


class LineOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """baudrate [bit/s] of the line; model: as printed on the servo; id: the servo's number on the line."""

    port: Port
    baudrate: Baudrate = 1_000_000
    model: str
    id: int


@dataclass(slots=True, eq=False)
class Servo:
    """One servo on the line; one that is silent rests until a time [s], and then for twice that ``pause`` [s]."""

    joint: str
    id: int
    model: Model
    question: Question | None
    """the plain question, of a servo that obeys no sync read"""
    pause: float = 0.0
    rests_until: float = 0.0


@dataclass(slots=True)
class _Group:
    """Servos with answers of one length that are asked together, every ``period`` [s], and when next [s]."""

    servos: list[Servo]
    period: float
    questions: list[Question]
    """the plain ones, in the order of the servos; none where a sync read asks all at once"""
    due: float = 0.0

    def skip(self, now: float) -> int:
        """Passes over the turns that have gone by; how many."""
        late = int((now - self.due) / self.period) + 1 if self.due <= now else 0
        self.due += late * self.period
        return late


Reply = tuple[Servo, tuple[float, bytes]]
"""a servo, the robot time [s] of its request, and its state block, or the answer to its plain question as it came"""


class LineBus(ABC):
    """All servos of one make on one port; see ``base.ServoBus``.

    Servos are asked at multiples of their poll period.  Those that obey no sync read are read one by one, the others by
    one sync read; whoever is missing in its answer is asked once more alone, because one silent servo may keep those
    after it from answering.  A sample's time is that of its request, which a servo obeys within its return delay (0.5
    ms as shipped); the answer's may be 16 ms later.
    """

    def __init__(
        self, joints: Sequence[LineOptions], models: Mapping[str, Model], port: ServoPort, clock: Clock
    ) -> None:
        """Raises DriverError for an unknown model, an id used twice or different baud rates."""
        check_line(joints, models)
        self._clock = clock
        self._servos = [_servo(joint, models[joint.model]) for joint in joints]
        alike: dict[tuple[float, int], list[Servo]] = {}
        for joint, servo in zip(joints, self._servos, strict=True):
            alike.setdefault((joint.poll_hz, servo.model.block_size), []).append(servo)
        self._groups = [_Group(servos, 1 / rate, _questions(servos)) for (rate, _), servos in alike.items()]
        self._line = port
        self.resolution_rad = max(servo.model.step for servo in self._servos)
        self._awake = 0.0  # from then on no servo rests [s]
        self._lost = self._broken = 0  # polls that were skipped, and bad frames, since the last reading

    def open(self) -> None:
        """Takes the port.  Raises PortError."""
        self._line.open()
        self._start()

    def identify(self) -> tuple[Identity, ...]:
        """Asks each servo for its model number.  Raises PortError."""
        found = [self._found(servo) for servo in self._servos]
        silence, gist = "no answer; likely cause: no power, another id, or another baudrate", ""
        if all(description is None for description in found):
            received = self._line.listen(EAVESDROP_S)
            if received:
                text = "no answer, but {} unasked; likely cause: another device on the port"
                silence, gist = text.format(repr(received[:24])), text.format("bytes")
        self._start()
        return tuple(
            self._identity(servo, description, silence, gist)
            for servo, description in zip(self._servos, found, strict=True)
        )

    def read(self) -> ServoReading:
        """Waits for the next poll, at most 0.3 s; the answers of this poll and of those until the next cycle begins: to
        look at each right after the wait for it, with cold caches, would cost far more.

        Raises PortError.
        """
        turn = min(group.due for group in self._groups)
        if turn - self._clock.now() > LONGEST_WAIT_S:
            time.sleep(LONGEST_WAIT_S)
            return ServoReading(silent=self._silent())
        replies: list[Reply] = []
        end = next_cycle(turn, self._clock.cycle_s)
        while turn < end:
            time.sleep(max(0.0, turn - self._clock.now()))
            self._poll(replies, end)
            turn = min(group.due for group in self._groups)
        samples = tuple(self._samples(replies))
        lost, broken, self._lost, self._broken = self._lost, self._broken, 0, 0
        return ServoReading(samples, self._silent(), lost, broken)

    def close(self) -> None:
        """Gives the port back."""
        self._line.close()

    @abstractmethod
    def _found(self, servo: Servo) -> str | None:
        """Which servo answers at this id, as by ``_description``; None when none does."""

    @abstractmethod
    def _description(self, number: int, protocol: int) -> str:
        """A model number and a protocol as a person reads them."""

    @abstractmethod
    def _search(self, servo: Servo) -> Sequence[int]:
        """A servo's state block among the noise or the pieces that came in instead of its plain answer."""

    @abstractmethod
    def _read_alone(self, servo: Servo) -> Sequence[int]:
        """The state block of one servo that would obey a sync read."""

    @abstractmethod
    def _sync_read(self, missing: dict[int, Servo], replies: list[Reply]) -> None:
        """Asks the servos by their ids all at once; takes those out of ``missing`` that answer."""

    def _identity(self, servo: Servo, description: str | None, silence: str, gist: str) -> Identity:
        expected = self._description(servo.model.number, servo.model.protocol)
        wanted = f"id {servo.id}: {expected}"
        if description is None:
            return Identity(servo.joint, silence, wanted, False, gist)
        return Identity(servo.joint, f"id {servo.id}: {description}", wanted, description == expected)

    def _start(self) -> None:
        for group in self._groups:
            group.due = self._clock.now()
        for servo in self._servos:
            servo.rests_until = servo.pause = 0.0
        self._awake = 0.0
        self._lost = self._broken = 0

    def _samples(self, replies: Iterable[Reply]) -> Iterator[ServoSample]:
        """The samples in replies, in SI units; an answer with a wrong checksum makes its servo a silent one."""
        for servo, (asked, block) in replies:
            if servo.question and len(block) == servo.question.length:
                block = servo.question.parameters(block)
                self._broken += not block
            self._note(servo, asked, bool(block))
            if block:
                command, position, velocity, voltage, heat, current = servo.model.decode(block)
                yield ServoSample(servo.joint, asked, command, position, velocity, math.nan, current, voltage, heat)

    def _poll(self, replies: list[Reply], end: float) -> None:
        """Asks the servos whose turn it is; where all are asked together and answer, in all turns before ``end`` [s].

        Few calls, because they come right after a wait: each costs ten times as much there as at other times.
        """
        now = self._clock.now()
        for group in self._groups:
            if group.due > now:
                continue
            asked, questions, until = group.servos, group.questions, end
            if now < self._awake:
                asked = [servo for servo in asked if servo.rests_until <= now]
                questions, until = _questions(asked), now
            turns = self._turns(group, len(asked), until if len(self._groups) == 1 else now)
            if group.questions:
                self._read_in_turn(asked, questions, replies, turns)
                self._lost += group.skip(self._clock.now()) * len(asked)
            else:
                for _ in turns:
                    self._read_group(asked, replies)

    def _turns(self, group: _Group, asked: int, until: float) -> Iterator[None]:
        """The turns of a group in which so many servos are asked, waiting for each: the present one, and those before a
        time [s] as long as no servo is silent."""
        while True:
            group.due += group.period
            yield
            now = self._clock.now()
            self._lost += group.skip(now) * asked
            if group.due >= until or now < self._awake:
                return
            time.sleep(max(0.0, group.due - now))

    def _read_in_turn(
        self, servos: list[Servo], questions: list[Question], replies: list[Reply], turns: Iterable[None]
    ) -> None:
        """Asks servos one after the other in each turn, whose answers are all of one length; until one is none.

        Those that look like answers are kept as they are: to look into them at once, after a wait, takes ten times as
        long as to look into all of a reading.
        """
        while servos:
            answers, good = self._line.ask(questions, self._clock.now, turns)
            replies.extend(zip(cycle(servos), answers, strict=False))
            if good:
                return
            servo, (asked, answer) = replies.pop()
            block: Sequence[int] = b""
            if not answer or len(answer) == questions[0].length:
                self._line.clear()
            else:
                block = self._search(servo)
            self._take(servo, asked, block, replies)
            rest = len(answers) % len(servos) or len(servos)
            servos, questions, turns = servos[rest:], questions[rest:], (None,)

    def _read_group(self, servos: list[Servo], replies: list[Reply]) -> None:
        """One sync read; those that were silent before, or are now, are asked alone."""
        lone = [servo for servo in servos if servo.pause]
        missing = {servo.id: servo for servo in servos if not servo.pause}
        if missing:
            self._sync_read(missing, replies)
        for servo in (*missing.values(), *lone):
            asked = self._clock.now()
            self._take(servo, asked, self._read_alone(servo), replies)

    def _take(self, servo: Servo, asked: float, data: Sequence[int], replies: list[Reply]) -> None:
        """Keeps a state block; one that is missing or of another size makes the servo a silent one."""
        good = len(data) == servo.model.block_size
        self._note(servo, asked, good)
        if good:
            replies.append((servo, (asked, bytes(data))))

    def _note(self, servo: Servo, asked: float, good: bool) -> None:
        """Takes down whether a servo has answered; a request before its last rest does not count."""
        if asked < servo.rests_until:
            return
        servo.pause = 0.0 if good else min(2 * servo.pause, LONGEST_PAUSE_S) or FIRST_PAUSE_S
        if not good:
            servo.rests_until = self._clock.now() + servo.pause
            self._awake = max(self._awake, servo.rests_until)

    def _silent(self) -> tuple[str, ...]:
        return tuple(servo.joint for servo in self._servos if servo.pause)


def _servo(joint: LineOptions, model: Model) -> Servo:
    question = None if model.syncs else Question(joint.id, model.address, model.block_size)
    return Servo(joint.name, joint.id, model, question)


def _questions(servos: Iterable[Servo]) -> list[Question]:
    return [servo.question for servo in servos if servo.question]


def line_bytes(model: Model) -> int:
    """Bytes of an answer with a state block, and of the question where it is asked alone."""
    answer = model.block_size + ANSWER_SIZE[model.protocol]
    return answer if model.syncs else answer + QUESTION_SIZE


def silence_s(poll_hz: float) -> float:
    """After how long without a word a joint that is only listened to is silent [s]."""
    return max(LEAST_SILENCE_S, SILENT_POLLS / poll_hz)


def check_line(joints: Sequence[LineOptions], models: Mapping[str, Model]) -> None:
    """Raises DriverError for an unknown model, an id used twice, or different baud rates on one line."""
    seen: dict[int, str] = {}
    for joint in joints:
        if joint.model not in models:
            raise DriverError(f"joint {joint.name}: no model {joint.model!r} is known{near(joint.model, models)}")
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
