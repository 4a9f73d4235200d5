"""The state blocks of servos in SI units."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.drivers.codec.servo_state import ADDRESS, MODELS, Model, ServoState

AX, X = MODELS["AX-12A"], MODELS["XM430-W350"]


def ax_block(goal: int = 512, position: int = 512, speed: int = 0) -> bytes:
    """What an AX-12A at 11.8 V and 41 °C shows from address 30."""
    return struct.pack("<HHHHHHBB", goal, 0, 1023, position, speed, 0, 118, 41)


def x_block(goal: int, current: int, velocity: int, position: int, drift: int = 0, trajectory: int = 0) -> bytes:
    """What an XM430 shows from address 116, with signed values."""
    return struct.pack("<iHBBhhiiiiHB", goal, 7, 0, 0, 0, current, velocity, position, drift, trajectory, 118, 41)


@pytest.mark.parametrize(("count", "degrees"), [(512, 0.0), (0, -150.0), (1023, 149.707)])
def test_ax_angles_are_centred(count: int, degrees: float) -> None:
    """Count 512 of an AX servo is 0 rad, and a count is 300°/1024."""
    state = AX.decode(ax_block(goal=count, position=count))
    assert math.degrees(state.command) == pytest.approx(degrees, abs=1e-3)
    assert state.position == state.command


def test_ax_speed_has_its_sign_in_bit_10() -> None:
    """0x400 + 100 is 100 counts of 0.111 rev/min clockwise, which is negative."""
    assert AX.decode(ax_block(speed=100)).velocity == pytest.approx(11.1 * math.tau / 60)
    assert AX.decode(ax_block(speed=0x400 + 100)).velocity == pytest.approx(-11.1 * math.tau / 60)


def test_x_values_are_signed() -> None:
    """Current, velocity and position of an X servo below zero stay below zero."""
    state = X.decode(x_block(goal=2048, current=-100, velocity=-10, position=-2048))
    assert state.current == pytest.approx(-0.269)
    assert state.velocity == pytest.approx(-2.29 * math.tau / 60)
    assert state.position == pytest.approx(-math.tau)
    assert state.command == 0.0
    assert [state.voltage, state.temperature] == pytest.approx([11.8, 41.0])


def test_the_profile_is_the_command_when_it_is_on() -> None:
    """A position trajectory that is not zero stands for the command; else the goal does."""
    assert X.decode(x_block(3072, 0, 0, 2048, drift=5, trajectory=2560)).command == pytest.approx(math.tau / 8)
    assert X.decode(x_block(3072, 0, 0, 2048)).command == pytest.approx(math.tau / 4)


def test_a_servo_without_a_current_sensor_tells_none() -> None:
    """The AX-12A and the XL430 measure no current; it is NaN, not 0."""
    assert math.isnan(AX.decode(ax_block()).current)
    assert math.isnan(MODELS["XL430-W250"].decode(x_block(2048, 55, 0, 2048)).current)


def test_block_sizes_are_those_of_the_manual() -> None:
    """14 bytes from 30 and 31 bytes from 116."""
    assert (ADDRESS[1], AX.block_size) == (30, 14)
    assert (ADDRESS[2], X.block_size) == (116, 31)


@given(st.sampled_from(list(MODELS.values())), st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(-5, 5))
def test_round_trip_within_a_count(model: Model, command: float, position: float, velocity: float) -> None:
    """What a servo is told to show is read back to half a count."""
    state = model.decode(model.encode(ServoState(command, position, velocity, 12.0, 40.0, 0.1)))
    assert state.command == pytest.approx(command, abs=model.step / 2 + 1e-9)
    assert state.position == pytest.approx(position, abs=model.step / 2 + 1e-9)
    assert state.velocity == pytest.approx(velocity, abs=model.speed / 2 + 1e-9)
    assert math.isnan(state.current) or state.current == pytest.approx(0.1, abs=model.ampere)
