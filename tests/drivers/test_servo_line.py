"""What holds for every make of polled servos: silence, broken and late answers, error bytes."""

from __future__ import annotations

from statistics import mode

import pytest

from lostmotion.drivers.emulator import Emulator
from tests.drivers.rigs import MOTION, readings, servo_bus, servo_line, until

every_kind = pytest.mark.parametrize("model", ["AX-12A", "XL330-M288", "STS3215", "SCS0009"])


@every_kind
def test_a_silent_servo_costs_the_others_little(model: str) -> None:
    """With one of three servos silent the others keep coming, the silent one is named, and it returns by itself."""
    line = servo_line(model, [1, 2, 3])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2, 3], model)
        bus.open()
        line.servos[2].silent = True
        found = readings(bus, 1.5)
        assert mode(r.silent for r in found[len(found) // 2 :]) == ("2",)
        assert len([s for r in found for s in r.samples if s.joint == "3"]) > 50  # 42 if it were waited for each time
        assert not [s for r in found for s in r.samples if s.joint == "2"]
        line.servos[2].silent = False
        until(lambda: any(s.joint == "2" for s in bus.read().samples))
        assert bus.read().silent == ()
        bus.close()


@every_kind
def test_corrupted_and_noisy_answers(model: str) -> None:
    """A wrong checksum makes that servo silent for the while; noise before an answer does no harm.  Where the frames
    are our own, not the SDK's of protocol 2.0, they are counted."""
    line = servo_line(model, [1, 2])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model)
        bus.open()
        line.corrupt = {1}
        found = readings(bus, 0.3)
        assert {s.joint for r in found for s in r.samples} == {"2"}
        assert (sum(r.broken for r in found) > 0) == (model != "XL330-M288")
        line.corrupt, line.garbage = set(), b"\x00\xff\x13"
        until(lambda: bus.read().silent == ())
        found = readings(bus, 0.3)
        assert {s.joint for r in found for s in r.samples} == {"1", "2"}
        bus.close()


@every_kind
def test_an_answer_that_comes_too_late_is_nobody_elses(model: str) -> None:
    """What slow servos say after their time is never another servo's, nor much older than it seems (frames have no
    number that would tell), and reading goes on."""
    line = servo_line(model, [1, 2])
    with Emulator(line) as emulator:
        bus = servo_bus(emulator.paths[0], [1, 2], model)
        bus.open()
        line.delay_s = 0.045
        found = readings(bus, 0.3)
        line.delay_s = 0.0
        until(lambda: bus.read().silent == ())
        found += readings(bus, 0.3)
        bus.close()
    samples = [s for r in found for s in r.samples]
    assert {s.joint for s in samples} == {"1", "2"}
    for sample in samples:
        then = sample.time + (1.7 if sample.joint == "1" else 0.0)
        goals = [MOTION.goal(then + age / 1000) for age in range(-150, 20)]
        assert min(abs(sample.command - goal) for goal in goals) < bus.resolution_rad / 2 + 0.005


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
