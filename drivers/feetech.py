"""Driver of Feetech serial bus servos: STS and SMS with a magnetic encoder, SCS with a potentiometer, also mixed.

It only reads; it never moves a servo.  The schedule of requests is in ``servo_line.py``; models, questions and
units in ``codec/feetech.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import lru_cache

from lostmotion.drivers.base import Driver, JointOptions, RobotOptions, ServoBus
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec.dynamixel import Question
from lostmotion.drivers.codec.feetech import (
    ADDRESS,
    IDENTITY_SIZE,
    MODELS,
    Listener,
    SyncQuestion,
    identity_question,
    model_number,
)
from lostmotion.drivers.codec.servo_state import model_name
from lostmotion.drivers.serial_port import Exchange
from lostmotion.drivers.servo_line import LineBus, LineOptions, Reply, Servo, line_bytes
from lostmotion.drivers.servo_port import ServoPort

__all__ = ["DRIVER", "FeetechOptions"]


class FeetechOptions(LineOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of a joint with a Feetech servo; see ``servo_line.LineOptions``."""

    def line_bytes(self) -> int:
        """An answer, and the question where the servo obeys no sync read."""
        return line_bytes(MODELS[self.model]) if self.model in MODELS else 0


class FeetechBus(LineBus):
    """All Feetech servos on one port; see ``servo_line.LineBus``.  STS and SMS obey a sync read.

    Nothing but READ and SYNC READ is ever sent.
    """

    def __init__(self, joints: Sequence[FeetechOptions], clock: Clock) -> None:
        """Raises DriverError for an unknown model, an id used twice or different baud rates."""
        super().__init__(joints, MODELS, ServoPort(joints[0].port, joints[0].baudrate), clock)

    def _found(self, servo: Servo) -> str | None:
        answer = self._ask(servo, identity_question(servo.id), IDENTITY_SIZE)
        return self._description(model_number(answer), 1) if answer else None

    def _description(self, number: int, protocol: int) -> str:
        return model_name(number, MODELS)

    def _search(self, servo: Servo) -> Sequence[int]:
        return self._answers((servo.id,), servo.model.block_size).get(servo.id, b"")

    def _read_alone(self, servo: Servo) -> Sequence[int]:
        size = servo.model.block_size
        return self._ask(servo, Question(servo.id, ADDRESS, size), size)

    def _sync_read(self, missing: dict[int, Servo], replies: list[Reply]) -> None:
        ids = tuple(missing)
        size = missing[ids[0]].model.block_size
        asked, blocks = self._exchange(_sync_question(ids, size), ids, size)
        for id, block in blocks.items():
            self._take(missing.pop(id), asked, block, replies)

    def _ask(self, servo: Servo, question: Question, size: int) -> bytes:
        """The bytes that one servo answers; none where it does not."""
        return self._exchange(question, (servo.id,), size)[1].get(servo.id, b"")

    def _exchange(self, question: Exchange, ids: Collection[int], size: int) -> tuple[float, dict[int, bytes]]:
        """When a question was asked [s], and what was answered, by id."""
        [(asked, answer)], good = self._line.ask([question], self._clock.now)
        return asked, self._answers(ids, size, answer if good or not answer else None)

    def _answers(self, ids: Collection[int], size: int, whole: bytes | None = None) -> dict[int, bytes]:
        """The answers of these servos by id, in ``whole``, or else in what comes in until the deadline."""
        listener = Listener(ids, size)
        listener.feed(iter(self._line.receive, b"") if whole is None else (whole,))
        self._broken += listener.broken
        return listener.found


@lru_cache(maxsize=16)
def _sync_question(ids: tuple[int, ...], size: int) -> SyncQuestion:
    return SyncQuestion(ids, ADDRESS, size)


def _make(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    return FeetechBus([joint for joint in joints if isinstance(joint, FeetechOptions)], clock)


DRIVER = Driver(
    name="feetech",
    summary="Feetech STS, SMS (magnetic encoder) and SCS (potentiometer) serial bus servos",
    servo=_make,
    joint_options=FeetechOptions,
)
