"""Restarts of the machine, and a disk that is full."""

from __future__ import annotations

import pytest

from tests.system.conftest import Boot
from tests.system.machine import Machine
from tests.system.robot import LOSTMOTION, install_with_robot, plug_in, scores, show, wait_for_scores

FOLDER = "/var/lib/private/lostmotion"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first one may build the image


@pytest.mark.parametrize("orderly", [True, False], ids=["shutdown", "power cut"])
def test_it_runs_again_after_a_restart(boot: Boot, orderly: bool) -> None:
    """After a shutdown, or a power cut, the service comes up by itself and goes on in the same history."""
    machine = boot()
    install_with_robot(machine)
    kept = wait_for_scores(machine)
    (machine.power_off if orderly else machine.cut_power)()
    machine.boot()
    assert machine.run("systemctl", "is-active", "lostmotion").strip() == "active"
    assert scores(machine) >= kept
    plug_in(machine)
    wait_for_scores(machine)


def test_a_full_disk_is_survived(boot: Boot) -> None:
    """While the disk is full the same process runs on and says so once; later all that it scored is written.  A service
    that is started on a full disk starts, and writes when there is room."""
    machine = boot()
    machine.run("mkdir", "-p", "-m", "700", "/var/lib/private")
    machine.run("mkdir", FOLDER)
    machine.run("mount", "-t", "tmpfs", "-o", "size=1m,mode=755", "tmpfs", FOLDER)
    install_with_robot(machine)
    wait_for_scores(machine)
    before = show(machine, "MainPID")
    fill(machine)
    machine.wait_until(lambda: machine.said("disk is full"))
    kept = scores(machine)
    machine.run("rm", f"{FOLDER}/filler")
    machine.wait_until(lambda: machine.said("written again; 0 rows were dropped"))
    assert scores(machine) > kept
    assert len(machine.said("disk is full")) == 1
    assert show(machine, "MainPID") == before
    fill(machine)
    machine.run("systemctl", "restart", "lostmotion")
    machine.wait_until(lambda: len(machine.said("scoring continues, rows wait in memory")) > 1)
    machine.wait_until(lambda: len(machine.said("tip: reading")) > 2)  # the summary says it too
    assert show(machine, "ActiveState") == "active"
    machine.run("rm", f"{FOLDER}/filler")
    wait_for_scores(machine)
    assert machine.run(LOSTMOTION, "status", "--json")


def fill(machine: Machine) -> None:
    """Leaves no byte in the folder of the data."""
    machine.run("dd", "if=/dev/zero", f"of={FOLDER}/filler", check=False)
