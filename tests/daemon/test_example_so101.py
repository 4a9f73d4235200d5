"""The example of an arm with Feetech servos, its hardware emulated byte by byte."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from lostmotion.daemon import config
from lostmotion.drivers.emulator import CsvStream, Emulator, FeetechLine, Motion
from lostmotion.drivers.feetech import FeetechOptions
from tests.conftest import ROOT
from tests.daemon.cli_world import call

EXAMPLE = (ROOT / "examples" / "so101.toml").read_text()
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]


def doctor(folder: Path, ids: Sequence[int], model: str = "STS3215") -> dict[tuple[str, str], Any]:
    """The doctor's checks, by subject and name, of an arm with these servos."""
    motion = Motion()
    with Emulator(FeetechLine.of(model, ids, motion), CsvStream(motion), link=folder / "tty") as arm:
        text = EXAMPLE.replace("/var/lib/lostmotion", str(folder))
        for name, path in zip(("/dev/ttyACM0", "/dev/ttyUSB0"), arm.paths, strict=True):
            text = text.replace(name, path)
        (folder / "so101.toml").write_text(text)
        found = json.loads(call("doctor", "--config", folder / "so101.toml", "--json").stdout)
    return {(check["subject"], check["check"]): check for check in found["checks"]}


def test_the_example_is_lerobots_arm() -> None:
    """LeRobot's six names and ids, each an STS3215; nothing is noted about the file."""
    arm = config.loads(EXAMPLE, "so101.toml")
    assert arm.notes == ()
    rows = [(joint.name, joint.id, joint.model) for joint in arm.joints if isinstance(joint, FeetechOptions)]
    assert rows == [(name, id, "STS3215") for id, name in enumerate(JOINTS, start=1)]


def until(
    folder: Path, ids: Sequence[int], model: str, right: Callable[[dict[tuple[str, str], Any]], bool]
) -> dict[tuple[str, str], Any]:
    """The doctor's checks of the first of five passes of which they are ``right``: a servo that is emulated on a busy
    machine now and then answers too late."""
    for _ in range(5):
        found = doctor(folder, ids, model)
        if right(found):
            return found
    raise AssertionError(f"in none of five passes; the last one: {found}")


@pytest.mark.slow
def test_doctor_knows_all_six_servos(tmp_path: Path) -> None:
    """Each joint's servo says who it is and is polled 100 times a second."""
    found = until(
        tmp_path, range(1, 7), "STS3215",
        lambda found: all(found[joint, check]["ok"] for joint in JOINTS for check in ("identity", "poll rate")),
    )  # fmt: skip
    for joint in JOINTS:
        assert "STS3215 (model number 777)" in found[joint, "identity"]["value"]
        assert found[joint, "poll rate"]["value"] == pytest.approx(100, rel=0.1)


@pytest.mark.slow
def test_doctor_names_a_wrong_model_and_a_missing_id(tmp_path: Path) -> None:
    """STS3250 servos at five of the six ids: five are told by their name, the gripper's does not answer."""

    def right(found: dict[tuple[str, str], Any]) -> bool:
        told = [found[joint, "identity"] for joint in JOINTS]
        named = all("STS3250 (model number 2825)" in check["value"] for check in told[:5])
        silent = "no answer; likely cause: no power, another id, or another baudrate" in told[5]["value"]
        return named and silent and not any(check["ok"] for check in told)

    until(tmp_path, range(1, 6), "STS3250", right)
