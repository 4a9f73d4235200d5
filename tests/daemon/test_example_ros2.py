"""The path of docs/ros2.md: every lostmotion command in it, with the example's configuration and an emulated robot."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lostmotion.drivers.emulator import Motion
from lostmotion.drivers.emulator.ros2 import Ros2Robot
from tests.conftest import ROOT
from tests.daemon.cli_world import call

EXAMPLE = (ROOT / "examples" / "ros2.toml").read_text()
PAGE = (ROOT / "docs" / "ros2.md").read_text()


def shown() -> list[list[str]]:
    """The commands of the page, without the program's name."""
    return [line.split()[2:] for line in re.findall(r"^\$ lostmotion.*", PAGE, flags=re.MULTILINE)]


@pytest.mark.slow
def test_every_command_of_the_page(tmp_path: Path) -> None:
    """config check lists no listening socket, doctor hears joint and sensor, run scores windows, history shows them."""
    assert [command[0] for command in shown()] == ["config", "doctor", "run", "history"]
    path = tmp_path / "ros2.toml"
    with Ros2Robot(Motion(play=1.0)) as robot:
        text = EXAMPLE.replace("/var/lib/lostmotion", str(tmp_path)).replace("tcp/127.0.0.1:7447", robot.paths[0])
        path.write_text(text)
        said = {
            command[0]: call(*(str(path) if word == "ros2.toml" else word for word in command)) for command in shown()
        }
    assert said["config"].exit_code == 0
    assert re.search(rf"ros2 +connects +{re.escape(robot.paths[0])}", said["config"].stdout)
    assert "listens" not in said["config"].stdout
    assert "joint 'joint1' at 100 Hz" in re.sub(r"\s+", " ", said["doctor"].stdout)
    assert said["run"].exit_code == 0
    assert said["history"].exit_code == 0
    assert len(said["history"].stdout.splitlines()) > 10
