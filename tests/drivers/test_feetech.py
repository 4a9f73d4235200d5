"""The Feetech driver against emulated servos that answer byte by byte."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from lostmotion.drivers.codec.dynamixel import READ, SYNC_READ, WRITE, Packet, decoder, encode
from lostmotion.drivers.codec.feetech import MODELS
from lostmotion.drivers.emulator import Emulator, FeetechLine, VirtualFeetech, VirtualServo
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.serial_port import SerialPort
from tests.drivers.rigs import MOTION, PATIENCE_S, Polls, Witness, readings, samples, servo_bus, some, until

STS_STEP, SCS_STEP = math.tau / 4096, math.radians(300 / 1024)
STS, SCS = "STS3215", "SCS0009"


class TappedLine(FeetechLine):
    """A line that keeps all that the master sends."""

    def __init__(self, servos: Iterable[VirtualServo]) -> None:
        super().__init__(servos)
        self.sent: list[bytes] = []

    def receive(self, data: bytes, now: float) -> None:
        self.sent.append(data)
        super().receive(data, now)

    def codes(self) -> set[int]:
        """The instructions among it, which is made of nothing but whole frames."""
        stream = decoder(1)
        found = {packet.code for packet in stream.feed(b"".join(self.sent)) if packet is not None}
        assert stream.broken == 0
        return found


class PatientLine(FeetechLine):
    """A line whose servos answer a sync read also after one that is silent."""

    def _asked(self, packet: Packet, protocol: int) -> Iterable[tuple[VirtualServo, bytes]]:
        if packet.code != SYNC_READ:
            yield from super()._asked(packet, protocol)
            return
        for id in packet.parameters[2:]:
            yield self.servos[id], packet.parameters[:2]


@pytest.mark.parametrize(("model", "step"), [(STS, STS_STEP), (SCS, SCS_STEP)])
def test_six_servos_follow_the_motion(model: str, step: float) -> None:
    """An arm's six servos at 100 Hz: commands are their goals, to half a count, when they answer what was asked at the
    samples' times, never too soon, and what a busy machine loses is counted."""
    ids = [1, 2, 3, 4, 5, 6]
    line = FeetechLine.of(model, ids, MOTION)
    servos = {str(id): Witness(servo) for id, servo in line.servos.items()}
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], ids, model)
        polls = Polls(bus)
        found = readings(bus, some(40, *servos))
        assert polls.are_counted(found, 6)
        bus.close()
    assert bus.resolution_rad == pytest.approx(step)
    assert sum(r.broken for r in found) <= 5
    for sample in samples(found):
        assert servos[sample.joint].confirms(sample)
        assert [sample.voltage, sample.temperature] == pytest.approx([11.8, 41.0])
        assert math.isnan(sample.torque)
        assert math.isnan(sample.current) == (model == SCS)


def test_nothing_but_reads_is_ever_sent() -> None:
    """Identifying, polling, a silent servo, broken answers and noise: every byte sent belongs to a READ or a SYNC READ,
    so that no servo is ever moved or set."""
    models = [STS, STS, SCS]
    line = TappedLine(VirtualFeetech(MODELS[model], id, MOTION) for id, model in enumerate(models, start=1))
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 3], models)
        bus.open()
        assert all(identity.ok for identity in bus.identify())
        readings(bus, some(10, "1", "2", "3"))
        line.servos[1].silent, line.corrupt = True, {2}
        readings(bus, lambda found: found[-1].silent == ("1", "2"))
        line.corrupt, line.garbage = set(), b"\x00\xff\x13"
        bus.identify()
        readings(bus, some(10, "2", "3"))
        bus.close()
    assert line.codes() == {READ, SYNC_READ}


def test_a_mixed_line() -> None:
    """STS servos by sync read and SCS servos one by one, on one line."""
    line = FeetechLine([VirtualFeetech(MODELS[STS], 1, MOTION), VirtualFeetech(MODELS[SCS], 2, MOTION)])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], [STS, SCS])
        bus.open()
        assert all(identity.ok for identity in bus.identify())
        found = readings(bus, some(20, "1", "2"))
        bus.close()
    assert np.mean([r.silent == () for r in found]) > 0.5  # but for exchanges that a busy machine makes longer


def test_a_silent_servo_that_nobody_waits_for() -> None:
    """Where the third servo answers a sync read in spite of the second's silence, its answer is taken."""
    line = PatientLine.of(STS, [1, 2, 3], MOTION)
    line.servos[2].silent = True
    with Emulator(line) as emulator:

        def is_taken() -> bool:
            """The first answers of a bus that nobody has used: of one and the same sync read, if none was late."""
            bus = servo_bus(emulator.paths[0], [1, 2, 3], STS)
            bus.open()
            first = bus.read()
            bus.close()
            times = [{s.time for s in first.samples if s.joint == joint} for joint in ("1", "2", "3")]
            assert not times[1]
            assert "2" in first.silent
            return first.silent == ("2",) and times[0] == times[2] != set()

        until(is_taken)


def test_one_broken_answer_to_a_sync_read_loses_no_sample() -> None:
    """The servo is asked once more alone: a sample all the same, and nobody is silent."""

    class Spoilt(FeetechLine):
        def receive(self, data: bytes, now: float) -> None:
            super().receive(data, now)
            if len(self._outbox) == 2:  # to a sync read
                when, frame = self._outbox[0]
                self._outbox[0] = when, frame[:-1] + bytes((frame[-1] ^ 0x55,))

    with Emulator(Spoilt.of(STS, [1, 2], MOTION)) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], STS)
        bus.open()
        found = readings(bus, some(40, "2"))
        bus.close()
    of_each = [len(samples(found, joint)) for joint in ("1", "2")]
    assert of_each[0] > 0.8 * of_each[1]  # a quarter if it rested each time
    assert sum(r.broken for r in found) > 0.8 * of_each[0]
    assert np.mean([r.silent == () for r in found]) > 0.5


@pytest.mark.parametrize("model", [STS, SCS])
def test_a_line_that_echoes(model: str) -> None:
    """Where transmitter and receiver share a wire, what is sent comes back before the answers: it is none of them."""

    class Echo(FeetechLine):
        def receive(self, data: bytes, now: float) -> None:
            self._outbox.append((now, data))
            super().receive(data, now)

    with Emulator(Echo.of(model, [1, 2], MOTION)) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 9], model)
        bus.open()
        assert [identity.ok for identity in bus.identify()] == [True, True, False]
        found = readings(bus, lambda found: some(10, "1", "2")(found) and found[-1].silent == ("9",))
        bus.close()
    assert {s.joint for s in samples(found)} == {"1", "2"}
    for sample in samples(found):
        assert abs(sample.command - sample.position) < 0.2


def test_answers_in_pieces_are_put_together() -> None:
    """An adapter may hand over the answers to a sync read cut anywhere; polls still give their samples, at once."""

    class Pieces(FeetechLine):
        def emit(self, now: float) -> bytes:
            data = super().emit(now)
            if len(data) > 17:
                self._outbox.insert(0, (now + 0.0003, data[17:]))
            return data[:17]

    with Emulator(Pieces.of(STS, [1, 2, 3], MOTION)) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 3], STS)
        bus.open()
        found = readings(bus, some(33, "1", "2", "3"))
        bus.close()
    times = [sample.time for sample in samples(found, "3")]
    assert np.median(np.diff(times)) < PATIENCE_S / 2  # more than that if each poll waited for its deadline
    assert sum(r.broken for r in found) <= 5  # those that a busy machine makes too late


def test_another_model_and_a_missing_id() -> None:
    """An STS3250 is not taken for an STS3215, an SCS0009 is told by its name in spite of its byte order, and an id that
    nobody has is told with the likely cause."""
    line = FeetechLine([VirtualFeetech(MODELS["STS3250"], 1, MOTION), VirtualFeetech(MODELS[SCS], 2, MOTION)])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 9], STS)
        bus.open()
        wrong, other, missing = bus.identify()
        bus.close()
    assert (wrong.ok, wrong.found) == (False, "id 1: STS3250 (model number 2825)")
    assert wrong.expected == "id 1: STS3215 (model number 777)"
    assert (other.ok, other.found) == (False, "id 2: SCS0009 (model number 1284)")
    assert (missing.ok, missing.found) == (False, "no answer; likely cause: no power, another id, or another baudrate")


@pytest.mark.parametrize(("model", "goal"), [(STS, b"\x00\x0c"), (SCS, b"\x03\x00")])
def test_a_goal_that_another_program_has_written_is_the_command(model: str, goal: bytes) -> None:
    """The emulated servo takes a goal in its own byte order, and answers a write elsewhere with an error."""
    line = FeetechLine.of(model, [1], MOTION)
    answers = []
    with Emulator(line) as emulator:
        port = SerialPort(emulator.paths[0], 1_000_000)
        port.open()
        for parameters in (b"\x2a" + goal, b"\x05\x07"):
            port.write(encode(Packet(1, WRITE, parameters), 1))
            answers += decoder(1).feed(port.read(60.0))
        port.close()
        bus = servo_bus(emulator.paths[0], [1], model)
        bus.open()
        sample = bus.read().samples[0]
        bus.close()
    assert answers == [Packet(1, 0), Packet(1, 8)]
    step, count = {STS: (STS_STEP, 3072 - 2048), SCS: (SCS_STEP, 768 - 512)}[model]
    assert (sample.command, sample.position, sample.velocity) == pytest.approx((count * step, count * step, 0.0))


@pytest.mark.parametrize(
    ("ids", "models", "message"),
    [
        ([1], [STS, "AX-12A"], "no model 'AX-12A' is known; there are STS3215, STS3250"),
        ([4, 4], [STS, STS], "have the same id 4"),
        ([1, 253], [STS, STS], "id is 253; expected 0 to 252"),
    ],
)
def test_impossible_settings_are_refused(ids: list[int], models: list[str], message: str) -> None:
    """A model of another make, an id used twice and an id out of range are told before the port is opened."""
    with pytest.raises(DriverError, match=message):
        servo_bus("/dev/null", [*ids, 2][:2], models)
