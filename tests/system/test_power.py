"""Restarts of the machine, and a disk that is full."""

from __future__ import annotations

import pytest

from tests.system.conftest import Boot
from tests.system.robot import LOSTMOTION, install_with_robot, plug_in, scores, show, wait_for_scores

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
    """While the disk is full the same process runs on and says so once; later all that it scored is written."""
    machine = boot()
    machine.run("mkdir", "-p", "-m", "700", "/var/lib/private")
    machine.run("mkdir", "/var/lib/private/lostmotion")
    machine.run("mount", "-t", "tmpfs", "-o", "size=1m,mode=755", "tmpfs", "/var/lib/private/lostmotion")
    install_with_robot(machine)
    wait_for_scores(machine)
    before = show(machine, "MainPID")
    machine.run("dd", "if=/dev/zero", "of=/var/lib/private/lostmotion/filler", check=False)
    machine.wait_until(lambda: machine.said("disk is full"))
    kept = scores(machine)
    machine.run("rm", "/var/lib/private/lostmotion/filler")
    machine.wait_until(lambda: machine.said("written again; 0 rows were given up meanwhile"))
    assert scores(machine) > kept
    assert len(machine.said("disk is full")) == 1
    assert show(machine, "MainPID") == before
    assert machine.run(LOSTMOTION, "status", "--json")
