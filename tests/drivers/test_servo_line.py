"""What holds for every make of polled servos: silence, broken and late answers, error bytes."""

from __future__ import annotations

import time
from itertools import pairwise
from statistics import mode

import pytest

from lostmotion.drivers.clock import CYCLE_S
from lostmotion.drivers.codec.dynamixel import Packet
from lostmotion.drivers.emulator import Emulator, VirtualServo
from lostmotion.drivers.servo_line import FIRST_PAUSE_S
from tests.drivers.rigs import Witness, readings, samples, servo_bus, servo_line, some

every_kind = pytest.mark.parametrize("model", ["AX-12A", "XL330-M288", "STS3215", "SCS0009"])


@every_kind
def test_a_silent_servo_costs_the_others_little(model: str) -> None:
    """With one of three servos silent the others keep coming, the silent one is named, and it returns by itself."""
    line = servo_line(model, [1, 2, 3])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 3], model)
        bus.open()
        line.servos[2].silent = True
        asked, since = when_asked(line.servos[2]), time.monotonic()
        found = readings(bus, some(50, "1", "3"))
        assert FIRST_PAUSE_S * (2 ** (len(asked) - 1) - 1) <= time.monotonic() - since  # pauses double
        assert mode(r.silent for r in found[len(found) // 2 :]) == ("2",)
        assert not samples(found, "2")
        line.servos[2].silent = False
        readings(bus, lambda found: samples(found, "2") and found[-1].silent == ())
        bus.close()


@pytest.mark.parametrize("cycle_s", [CYCLE_S, 0.02])
@every_kind
def test_a_reading_ends_with_its_cycle(model: str, cycle_s: float) -> None:
    """All polls of one cycle, which begins at a multiple of its length for every device, come together, and are
    counted.  Where a busy machine holds a poll up into the next cycle, two readings begin in that one."""
    with Emulator(servo_line(model, [1, 2])) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model, cycle_s=cycle_s)
        bus.open()
        found = readings(bus, some(80, "1", "2"))[1:]
        bus.close()
    begins = [reading.samples[0].time for reading in found if reading.samples]
    again = sum(one // cycle_s >= other // cycle_s for one, other in pairwise(begins))
    assert again <= len(begins) / 4  # half of them, if each poll came alone
    polled = sum(len(reading.samples) + reading.lost for reading in found[:-1])
    assert polled == pytest.approx(2 * 100 * (begins[-1] - begins[0]), abs=12)


def when_asked(servo: VirtualServo) -> list[float]:
    """When a servo is asked alone, from now on [s]."""
    times, answer = list[float](), servo.answer

    def noted(packet: Packet, now: float) -> Packet | None:
        times.append(now)
        return answer(packet, now)

    servo.answer = noted  # type: ignore[method-assign]
    return times


@every_kind
def test_corrupted_and_noisy_answers(model: str) -> None:
    """A wrong checksum makes that servo silent for the while; noise before an answer does no harm.  Where the frames
    are our own, not the SDK's of protocol 2.0, they are counted."""
    line = servo_line(model, [1, 2])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model)
        bus.open()
        line.corrupt = {1}
        found = readings(bus, some(20, "2"))
        assert {s.joint for s in samples(found)} == {"2"}
        assert (sum(r.broken for r in found) > 0) == (model != "XL330-M288")
        line.corrupt, line.garbage = set(), b"\x00\xff\x13"
        readings(bus, lambda found: some(10, "1", "2")(found) and found[-1].silent == ())
        bus.close()


@every_kind
def test_an_answer_that_comes_too_late_is_nobody_elses(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What slow servos say after their time is never another servo's, nor older than the answer to one of the two
    questions before (frames have no number that would tell), and reading goes on."""
    monkeypatch.setattr("lostmotion.drivers.servo_port.LATENCY_S", 0.034)
    line = servo_line(model, [1, 2])
    servos = {str(id): Witness(servo) for id, servo in line.servos.items()}
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model)
        bus.open()
        line.delay_s = 0.045
        found = readings(bus, lambda found: len(found) > 2 and found[-1].silent)
        line.delay_s = 0.0
        found += readings(bus, lambda found: some(20, "1", "2")(found) and found[-1].silent == ())
        bus.close()
    for sample in samples(found):
        assert servos[sample.joint].confirms(sample, older=2)


@every_kind
def test_an_error_byte_does_not_hide_the_data(model: str) -> None:
    """A servo that reports overheating (error 4) is still known and read."""
    line = servo_line(model, [1])
    line.servos[1].error = 4
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1], model)
        bus.open()
        assert bus.identify()[0].ok
        assert bus.read().samples
        bus.close()
