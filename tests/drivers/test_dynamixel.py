"""The Dynamixel driver against emulated servos that answer byte by byte."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler

from lostmotion.drivers.codec.servo_state import MODELS
from lostmotion.drivers.dynamixel_port import BusPort
from lostmotion.drivers.emulator import Emulator, ServoLine, TextStream, VirtualServo
from lostmotion.drivers.errors import DriverError
from tests.drivers.rigs import MOTION, Polls, Witness, readings, samples, servo_bus, some, until

AX_STEP, X_STEP = math.radians(300 / 1024), math.tau / 4096


@pytest.mark.parametrize(("model", "step"), [("AX-12A", AX_STEP), ("XL330-M288", X_STEP)])
def test_samples_follow_the_motion(model: str, step: float) -> None:
    """Commands are the servo's goals, to half a count, when it answers what was asked at the samples' times: at 100 Hz,
    never sooner, and what a busy machine loses is counted."""
    line = ServoLine.of(model, [1, 2], MOTION)
    servo = Witness(line.servos[2])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model)
        polls = Polls(bus)
        found = readings(bus, some(60, "1", "2"))
        assert polls.are_counted(found, 2)
        bus.close()
    assert bus.resolution_rad == pytest.approx(step)
    for sample in samples(found, "2"):
        assert servo.confirms(sample)
        assert [sample.voltage, sample.temperature] == pytest.approx([11.8, 41.0])


def test_a_silent_servo_does_not_zero_the_sync_read() -> None:
    """On protocol 2.0 a silent servo keeps those after it from answering; they are read alone, and none reads 0."""
    line = ServoLine.of("XL330-M288", [1, 2, 3], MOTION)
    with Emulator(line) as emulator:
        port = BusPort(emulator.paths[0], 1_000_000)
        port.open()
        for id in line.servos:
            assert Protocol2PacketHandler().write4ByteTxRx(port, id, 116, 2374) == (0, 0)
        port.close()
        bus = servo_bus(emulator.paths[0], [1, 2, 3], "XL330-M288")
        bus.open()
        line.servos[1].silent = True
        found = samples(readings(bus, some(50, "2", "3")))
        bus.close()
    assert {s.joint for s in found} == {"2", "3"}
    assert all(s.position == pytest.approx(326 * X_STEP) for s in found)


def test_mixed_protocols_on_one_line() -> None:
    """An AX-12A and an XL330 on one line are both read."""
    line = ServoLine([VirtualServo(MODELS["AX-12A"], 1, MOTION), VirtualServo(MODELS["XL330-M288"], 2, MOTION)])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], ["AX-12A", "XL330-M288"])
        bus.open()
        assert all(identity.ok for identity in bus.identify())
        found = readings(bus, some(20, "1", "2"))
        bus.close()
    assert np.mean([r.silent == () for r in found]) > 0.5  # but for exchanges that a busy machine makes longer


def test_what_a_servo_said_before_it_fell_silent_counts() -> None:
    """Answers are looked into together: those of the polls before are samples, and the servo is a silent one."""

    class Dying(VirtualServo):
        def read(self, parameters: bytes, now: float) -> bytes:
            data = super().read(parameters, now)
            left[0] -= 1
            self.silent = not left[0]
            return data

    left = [3]
    line = ServoLine([Dying(MODELS["AX-12A"], 1, MOTION), VirtualServo(MODELS["AX-12A"], 2, MOTION)])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2])
        bus.open()
        found = readings(bus, lambda found: found[-1].silent)
        bus.close()
    assert len(samples(found, "1")) == 3
    assert found[-1].silent == ("1",)


def test_one_wrong_checksum_loses_one_sample() -> None:
    """Noise on the line spoils an answer: that poll is lost, the servo rests and is back, no sample is wrong."""
    line = ServoLine.of("AX-12A", [1, 2], MOTION)
    line.corrupt = {1}
    servos = {str(id): Witness(servo) for id, servo in line.servos.items()}
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2])
        bus.open()
        first = bus.read()
        assert first.silent == ("1",)
        assert {sample.joint for sample in first.samples} == {"2"}
        line.corrupt = set()
        found = [first, *readings(bus, lambda found: some(5, "1", "2")(found) and found[-1].silent == ())]
        bus.close()
    assert all(servos[sample.joint].confirms(sample) for sample in samples(found))


def test_an_answer_in_pieces_is_put_together() -> None:
    """An adapter may hand over an answer in two; polls still give their samples, and nobody is silent, but for
    exchanges that a busy machine makes longer."""

    class Halves(ServoLine):
        def emit(self, now: float) -> bytes:
            data = super().emit(now)
            if len(data) > 10:
                self._outbox.insert(0, (now + 0.0005, data[10:]))
            return data[:10]

    line = Halves.of("AX-12A", [1, 2], MOTION)
    servos = {str(id): Witness(servo) for id, servo in line.servos.items()}
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2])
        bus.open()
        found = readings(bus, some(50, "1", "2"))
        bus.close()
    assert np.mean([r.silent == () for r in found]) > 0.5
    assert all(servos[sample.joint].confirms(sample) for sample in samples(found))


def test_polls_that_did_not_fit_are_counted() -> None:
    """Three servos that take 8 ms each cannot be polled at 100 Hz: from one reading to the next, samples and lost
    polls add up to the turns of three servos.  A busy machine silences a servo at times: only whole readings count."""
    line = ServoLine.of("AX-12A", [1, 2, 3], MOTION)
    line.delay_s = 0.008
    counts: list[tuple[int, int, int]] = []
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 3])
        bus.open()
        before = bus.read()

        def has_enough() -> bool:
            nonlocal before
            now = bus.read()
            if before.samples and now.samples and not before.silent and not now.silent:
                turns = round(100 * (now.samples[0].time - before.samples[0].time))
                counts.append((3 * turns, len(before.samples), before.lost))
            before = now
            return len(counts) > 8

        until(has_enough)
        bus.close()
    turns, samples, lost = np.median(counts, axis=0)
    assert lost > samples
    assert samples + lost == pytest.approx(turns, abs=3)


def test_an_ax_where_an_x_is_expected() -> None:
    """The identity tells the model and the protocol found, and those expected."""
    with Emulator(ServoLine.of("AX-12A", [1], MOTION)) as emulator:
        bus = servo_bus(emulator.paths[0], [1], "XL330-M288")
        bus.open()
        (identity,) = bus.identify()
        bus.close()
    assert not identity.ok
    assert identity.found == "id 1: AX-12A (model number 12), protocol 1.0"
    assert identity.expected == "id 1: XL330-M288 (model number 1200), protocol 2.0"


def test_another_model_and_a_missing_id() -> None:
    """An AX-18A is not taken for an AX-12A, and an id that nobody has is told with the likely cause."""
    with Emulator(ServoLine.of("AX-18A", [1], MOTION)) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 9])
        bus.open()
        wrong, missing = bus.identify()
        bus.close()
    assert (wrong.ok, wrong.found) == (False, "id 1: AX-18A (model number 18), protocol 1.0")
    assert (missing.ok, missing.found) == (False, "no answer; likely cause: no power, another id, or another baudrate")


def test_a_gps_receiver_instead_of_servos() -> None:
    """Bytes that nobody asked for are shown; reading goes on in silence and never hangs."""
    with Emulator(TextStream()) as emulator:
        bus = servo_bus(emulator.paths[0], [1])
        bus.open()
        (identity,) = bus.identify()
        assert not identity.ok
        assert "$GPGGA" in identity.found
        assert "another device on the port" in identity.found
        found = readings(bus, lambda found: len(found) > 4 and found[-1].silent)
        bus.close()
    assert not samples(found)
    assert found[-1].silent == ("1",)


def test_a_stream_that_never_ends_holds_no_read() -> None:
    """A device that sends without pause cannot keep the SDK in its loop: an exchange ends at its deadline."""

    class Flood(TextStream):
        def due(self) -> float:
            return 0.0

        def emit(self, now: float) -> bytes:
            time.sleep(0.001)
            return b"\xff\xfe\xff\xff\xf0" * 40

    with Emulator(Flood()) as emulator:
        port = BusPort(emulator.paths[0], 1_000_000)
        port.open()
        start = time.monotonic()
        _, result, _ = Protocol1PacketHandler().readTxRx(port, 1, 30, 14)
        assert result != 0
        assert time.monotonic() - start < 60  # it takes a second; the flood never ends
        port.close()


@pytest.mark.parametrize(
    ("ids", "models", "message"),
    [
        ([1], "STS", "no model 'STS' is known; there are AX-12A, AX-12W"),
        ([1], "ax12a", "no model 'ax12a' is known; did you mean AX-12A"),
        ([1], "XL330-288", "no model 'XL330-288' is known; did you mean XL330-M288"),
        ([4, 4], "AX-12A", "have the same id 4"),
        ([300], "AX-12A", "id is 300; expected 0 to 252"),
    ],
)
def test_impossible_settings_are_refused(ids: list[int], models: str, message: str) -> None:
    """An unknown model, an id used twice and an id out of range are told before the port is opened."""
    with pytest.raises(DriverError, match=message):
        servo_bus("/dev/null", ids, models)


def test_a_rate_of_zero_is_refused() -> None:
    """poll_hz must be more than 0."""
    with pytest.raises(DriverError, match="poll_hz is 0"):
        servo_bus("/dev/null", [1], poll_hz=0)
