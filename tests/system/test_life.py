"""What can befall a service that watches a (emulated) robot: hangs, kills, new configurations."""

from __future__ import annotations

import pytest

from tests.system.conftest import Boot
from tests.system.machine import Machine
from tests.system.robot import CONFIG, TEXT, install_with_robot, scores, show, wait_for_scores

pytestmark = pytest.mark.slow

ERROR = "3"


@pytest.fixture(scope="module")
def machine(boot: Boot) -> Machine:
    """The service reads a servo and a sensor through serial ports, and has scored."""
    machine = boot()
    install_with_robot(machine)
    wait_for_scores(machine)
    return machine


def test_a_hanging_service_is_started_again(machine: Machine) -> None:
    """Stopped by SIGSTOP, it feeds no watchdog; systemd ends it, and the new one scores on."""
    before, kept = show(machine, "MainPID"), scores(machine)
    machine.run("sh", "-c", f"kill -STOP {before}")
    machine.wait_until(lambda: show(machine, "MainPID") not in (before, "0"))
    assert machine.said("Watchdog timeout")
    assert wait_for_scores(machine) > kept


def test_a_killed_service_is_started_again(machine: Machine) -> None:
    """After kill -9 a new process runs at once, with all that was scored before."""
    before, kept = show(machine, "MainPID"), scores(machine)
    machine.run("sh", "-c", f"kill -KILL {before}")
    machine.wait_until(lambda: show(machine, "MainPID") not in (before, "0"))
    machine.wait_until(lambda: show(machine, "ActiveState") == "active")
    assert scores(machine) >= kept
    wait_for_scores(machine)


def test_a_good_configuration_is_taken_over(machine: Machine) -> None:
    """After systemctl reload the same process runs with the new robot's name."""
    before = show(machine, "MainPID")
    machine.write(CONFIG, TEXT.replace("arm1", "arm2"))
    machine.run("systemctl", "reload", "lostmotion")
    machine.wait_until(lambda: machine.said("configuration taken: robot arm2, 1 joints"))
    assert show(machine, "MainPID") == before
    assert show(machine, "ActiveState") == "active"
    wait_for_scores(machine)


def test_a_bad_configuration_is_refused(machine: Machine) -> None:
    """The old one stays in force in the same process; the log holds one line of priority error that names the key."""
    before, told = show(machine, "MainPID"), len(machine.journal("-p", ERROR))
    machine.write(CONFIG, TEXT.replace("rate_hz", "rate_hertz"))
    machine.run("systemctl", "reload", "lostmotion")
    machine.wait_until(lambda: len(machine.journal("-p", ERROR)) > told)
    (line,) = machine.journal("-p", ERROR)[told:]
    expected = (
        f"the old configuration stays: {CONFIG}: accelerometer 'tip'.rate_hertz: unknown key; did you mean rate_hz?"
    )
    assert line["MESSAGE"] == expected
    assert (line["PRIORITY"], line["_PID"]) == (ERROR, before)
    machine.write(CONFIG, TEXT)
    wait_for_scores(machine)
