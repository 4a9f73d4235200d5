"""Commands of motors that a robot publishes by themselves: held where they come only when they change, else told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.goal import follows
from tests.drivers.test_formats import read

T = np.arange(2000) * 0.002
ANGLE = np.where(T < 1.0, 0.0, 0.5 * (T - 1.0) ** 2)
HEADER = "__time,/joint_states/joint0/position,/joint_states/joint1/position"
SENT = {1.0001: 2.0, 2.5001: -1.0}


def log(path: Path, topic: str, states: str = "", sent: dict[float, float] = SENT) -> Path:
    """A log of joint states, and of a topic with a message only where its value changes.  states: of the effort."""
    rows = {t: f"{t:.6f},{q:.9f},0.5{',0.0' * bool(states)}," for t, q in zip(T, ANGLE, strict=True)}
    rows |= {t: f"{t:.6f},,{',' * bool(states)},{value}" for t, value in sent.items()}
    path.write_text("\n".join([f"{HEADER}{states},{topic}", *(rows[t] for t in sorted(rows))]) + "\n")
    return path


def test_a_command_that_is_published_on_change_is_held(tmp_path: Path) -> None:
    """The readings know the command from its first message on."""
    path = log(tmp_path / "steps.csv", "/effort_control/data.0")
    found = read(path, "torque=/effort_control/data.0", joint="joint0")
    time, torque = found.recording.signal("torque")
    assert np.isfinite(found.recording.columns["position"]).all()
    np.testing.assert_allclose(time, T[T > 1.0001])
    np.testing.assert_allclose(torque, np.where(time < 2.5001, 2.0, -1.0))
    assert "torque: /effort_control/data.0 has 2 messages; each value is held until the next one" in found.notes


@pytest.mark.parametrize("topic", ["/wrench/torque", "/joint_states/effort_measured_command"])
def test_a_sensor_is_never_held(topic: str, tmp_path: Path) -> None:
    path = log(tmp_path / "slow.csv", topic)
    assert read(path, f"torque={topic}", joint="joint0").recording.signal("torque")[0].size == len(SENT)


def test_a_command_at_the_rate_of_the_readings_is_not_held(tmp_path: Path) -> None:
    path = log(tmp_path / "sine.csv", "/effort_control/data.0", sent={t + 5e-4: np.sin(t) for t in T[::4]})
    found = read(path, "torque=/effort_control/data.0", joint="joint0")
    assert found.recording.signal("torque")[0].size == T[::4].size


@pytest.mark.parametrize(
    ("topic", "option"),
    [
        ("/effort_control/data.0", "--map torque=/effort_control/data.0"),
        ("/wheel/command.data", "--map torque=/wheel/command.data, or for a goal --map command=/wheel/command.data"),
    ],
)
@pytest.mark.parametrize("states", [",/joint_states/joint0/effort", ""])
def test_a_command_that_is_not_used_is_told(topic: str, option: str, states: str, tmp_path: Path) -> None:
    """Also where the states have an effort that is zero throughout."""
    (note,) = [one for one in read(log(tmp_path / "x.csv", topic, states), joint="joint0").notes if "drives it" in one]
    assert note.endswith(f" use {option}")
    assert ("zero throughout" if states else f"{topic} is not used, and the motion is taken as free") in note


@pytest.mark.parametrize("name", ["commanded_deg_s", "goal_velocity"])
def test_a_speed_that_is_asked_for_tells_that_a_motor_drives(name: str, tmp_path: Path) -> None:
    """It is no goal of the angle, and no free motion follows it."""
    found = read(log(tmp_path / "x.csv", name), joint="joint0")
    assert [one.column for one in found.columns] == ["position"]
    (note,) = [one for one in found.notes if one.startswith(name)]
    assert "a motor drives the motion, which is taken as free" in note
    assert note.endswith("--map torque=SERIES")


@pytest.mark.parametrize("topic", ["/effort_command/joint1", "/effort_control/layout", "/temperature", "/measured/u"])
def test_what_drives_no_joint_or_another_one_is_not_told(topic: str, tmp_path: Path) -> None:
    found = read(log(tmp_path / "x.csv", topic), joint="joint0")
    assert not [one for one in found.notes if "drives it" in one]


def test_a_bag_holds_a_command_as_a_table_does(tmp_path: Path) -> None:
    """A topic has times of its own, of receipt: the readings are at the same times with and without the command."""
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        states = writer.register_channel("/states", "json", schema)
        command = writer.register_channel("/effort_control", "json", schema)
        logged = [(round(t * 1e9), states, {"position": q}) for t, q in zip(T, ANGLE, strict=True)]
        logged += [(round(t * 1e9), command, {"data": value}) for t, value in SENT.items()]
        for at, channel, value in sorted(logged, key=lambda one: one[:2]):
            writer.add_message(channel, 10**18 + at, json.dumps(value).encode(), 10**18 + at)
        writer.finish()
    found = read(path, "torque=/effort_control.data").recording
    np.testing.assert_allclose(found.columns["position"], ANGLE)
    time, torque = found.signal("torque")
    np.testing.assert_allclose(torque, np.where(time < 2.5001, 2.0, -1.0))
    assert time[0] == pytest.approx(1.002)


def driven(by_goal: bool) -> tuple[np.ndarray, np.ndarray]:
    """A sweep and the angle of a motor, held at it by a controller, or with it as the voltage."""
    u = 50 * np.sin(2 * np.pi * (0.5 * T + 0.4 * T**2))
    angle, speed, found = 0.0, 0.0, []
    for each in u:
        found.append(angle)
        speed += 0.002 * 40 * ((20 * (each - angle) if by_goal else each) - speed)
        angle += 0.002 * speed
    return u, np.rint(found)


def test_an_input_that_the_angle_follows_is_told_as_a_goal(tmp_path: Path) -> None:
    """In ``t u v theta`` u is the goal, which does not drive the motor; v is what does."""
    path = tmp_path / "ruler.csv"
    for by_goal in (True, False):
        u, angle = driven(by_goal)
        rows = [f"{t:.3f},{a:.6f},{a - q:.0f},{q:.0f}" for t, a, q in zip(T, u, angle, strict=True)]
        path.write_text("\n".join(["t,u,v,theta", *rows]) + "\n")
        notes = [one for one in read(path).notes if "as the goal" in one]
        assert len(notes) == by_goal
    assert abs(follows(T, *driven(True)) - 1) < 0.1
    assert follows(T, u, np.zeros_like(u)) == 0
    often = np.linspace(T[0], T[-1], 50_000)
    assert abs(follows(often, *(np.interp(often, T, each) for each in driven(True))) - 1) < 0.1


def test_the_note_of_a_goal_says_what_to_type(tmp_path: Path) -> None:
    u, angle = driven(True)
    rows = [f"{t:.3f},{a:.6f},{a - q:.0f},{q:.0f}" for t, a, q in zip(T, u, angle, strict=True)]
    path = tmp_path / "ruler.csv"
    path.write_text("\n".join(["t,u,v,theta", *rows]) + "\n")
    (note,) = [one for one in read(path).notes if "as the goal" in one]
    assert "if it drives the motor, use --map voltage=u, or give what drives it: --map voltage=v" in note
    assert {one.column for one in read(path).columns} == {"command", "position"}
    assert {one.column for one in read(path, "voltage=v").columns} >= {"voltage", "position"}
    assert {one.column for one in read(path, "voltage=u").columns} == {"voltage", "position"}


def test_a_servo_follows_a_goal_without_a_name(tmp_path: Path) -> None:
    """A table without a header: time, goal, goal, angle, speed.  Another base has no goal, and what the angle precedes
    is none."""
    path, late = tmp_path / "sweep.csv", tmp_path / "late.csv"
    goal, angle = driven(True)
    table = np.column_stack([T, goal / 50, goal / 50, angle / 50, np.gradient(angle / 50, T)])
    np.savetxt(path, table, fmt="%.6f", delimiter=",")
    found = read(path, base="servo")
    assert {one.column: one.series for one in found.columns} == {"command": "column2", "position": "column4"}
    assert not [note for note in found.notes if "taken as free" in note]
    assert [one.column for one in read(path).columns] == ["position"]
    np.savetxt(late, np.column_stack([T, np.roll(angle, 150), angle, np.gradient(angle, T)]), fmt="%.6f", delimiter=",")
    assert [one.column for one in read(late, base="servo").columns] == ["position"]


@pytest.mark.parametrize("is_driven", [True, False])
def test_a_switched_input_that_the_acceleration_follows_drives(is_driven: bool, tmp_path: Path) -> None:
    """A cart is driven to and fro by a current of either sign, which a table without a header has beside place and
    speed.  A mark of the side on which a pendulum is has as many values, and drives nothing."""
    place, speed, sent = (0.5, 0.0, 4.0) if is_driven else (1.5, 0.0, 0.0)
    found = []
    for _ in T:
        sent = (-4.0 if place > 0.7 else 4.0 if place < 0.3 else sent) if is_driven else np.sign(place)
        found.append((sent, place, speed))
        force = 2 * sent - 1.2 * np.tanh(speed / 1e-2) if is_driven else -30 * np.sin(place) - 0.1 * speed
        speed += 0.002 * force
        place += 0.002 * speed
    path = tmp_path / "cart.csv"
    np.savetxt(path, np.column_stack([T, found]), fmt="%.6f", delimiter=",")
    read_of = read(path)
    columns = {one.column: one.series for one in read_of.columns}
    assert columns == {"position": "column3", **({"voltage": "column2"} if is_driven else {})}
    assert any("column2 has 2 values and is not used" in note for note in read_of.notes) is not is_driven
    assert ("not used: column4" in read_of.notes) is is_driven


def test_a_current_that_no_motor_of_a_robot_has_is_doubted(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    for size, is_told in ((1500.0, True), (15.0, False)):
        table = np.column_stack([T, np.sin(5 * T), size * np.cos(5 * T)])
        np.savetxt(path, table, fmt="%.6f", delimiter=",", header="t,position,current", comments="")
        assert any("if they are mA, use --map current=current:mA" in note for note in read(path).notes) is is_told


@pytest.mark.parametrize(("levels", "is_told"), [(1, False), (2, True), (3, True), (200, False)])
def test_a_switched_input_without_a_name_is_told(levels: int, is_told: bool, tmp_path: Path) -> None:
    """A table without a header: time, a motor's voltage in a few steps, a swing and its speed.  What never changes, and
    what has as many values as a sensor, is not told."""
    swing = np.sin(5 * T) * np.exp(-0.1 * T)
    speed = np.gradient(swing, T)
    switched = np.floor(T / T[-1] * (levels - 1e-9)) - 1.0
    path = tmp_path / "plain.csv"
    np.savetxt(path, np.column_stack([T, switched, swing, speed]), fmt="%.6f", delimiter=",")
    found = read(path)
    assert found.columns[0].series == "column3"
    told = f"column2 has {levels} values and is not used, and the motion is taken as free"
    assert any(note.startswith(told) for note in found.notes) is is_told
    assert not is_told or read(path, "voltage=column2", "position=column3").recording.columns["voltage"].any()


@pytest.mark.parametrize(("demand", "is_nearer"), [("profile", True), ("shifted", False), ("echo", False)])
def test_of_several_goals_the_one_that_the_position_follows_is_the_command(
    demand: str, is_nearer: bool, tmp_path: Path
) -> None:
    """A drive turns the steps that it was sent into a smooth motion, and asks for that: the first goal would need a
    limit of the speed, or look like a weight.  A goal that is no nearer, or the position itself, changes nothing."""
    target = np.where(T % 2 < 1, 30.0, -30.0)
    turns, places = [0, 0.4, 1.0, 1.4, 2.0, 2.4, 3.0, 3.4, 4.0], [-30, 30, 30, -30, -30, 30, 30, -30, -30]
    profile = np.interp(T, turns, places)
    actual = np.interp(T - 0.01, T, profile)
    other = {"profile": profile, "shifted": target + 1.0, "echo": actual}[demand]
    path = tmp_path / "drive.csv"
    header = "Time (s),Position Target (degrees),Position Demand (degrees),Position Actual (degrees)"
    np.savetxt(path, np.column_stack([T, target, other, actual]), "%.6f", ",", header=header, comments="")
    found = read(path)
    names = ["Position Demand (degrees)", "Position Target (degrees)"]
    taken, left = names if is_nearer else names[::-1]
    assert found.columns[0].series == taken
    assert f"command: also found {left}" in found.notes
    assert f"not used: {left}" in found.notes
    assert read(path, "command=Position Target (degrees)").columns[0].why == "given"


def test_what_is_switched_is_not_suggested_as_the_position(tmp_path: Path) -> None:
    """A dynamometer's log without names: a supply and a current of two readings each, the speed of a wheel that coasts
    down with dropouts, and a clock in ms."""
    rng = np.random.default_rng(0)
    supply, current = 29.98 + 0.01 * (T > 3), 0.37 + 0.08 * rng.integers(0, 2, T.size)
    speed = np.where(rng.random(T.size) < 0.002, 0.0, 900 * np.exp(-0.3 * T))
    path = tmp_path / "spindown.txt"
    np.savetxt(path, np.column_stack([supply, current, speed, 1e3 + 1e3 * T]), "%.2f")
    with pytest.raises(RecordingError, match="--map position=column3:deg"):
        read(path)
