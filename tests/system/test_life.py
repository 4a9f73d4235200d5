"""What can befall a service that watches a (emulated) robot: hangs, kills, new configurations."""

from __future__ import annotations

import json
import time

import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.system.conftest import Boot
from tests.system.image import VENV
from tests.system.machine import Machine
from tests.system.robot import (
    CONFIG,
    LOSTMOTION,
    TEXT,
    WATCHDOG_S,
    install_with_robot,
    plug_in,
    scores,
    show,
    wait_for_scores,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first one may build the image

ERROR = "3"


@pytest.fixture(scope="module")
def machine(boot: Boot) -> Machine:
    """The service reads a servo and a sensor through serial ports, and has scored."""
    machine = boot()
    install_with_robot(machine)
    wait_for_scores(machine)
    return machine


def test_metrics_are_there_under_all_the_hardening(machine: Machine) -> None:
    """Prometheus' question is answered with scores and with what the process itself takes."""
    script = "from urllib.request import urlopen; print(urlopen('http://127.0.0.1:9464/metrics').read().decode())"
    text = machine.run(f"{VENV}/bin/python", "-c", script)
    found = {family.name: family.samples for family in text_string_to_metric_families(text)}
    assert found["lostmotion_joint_score"][0].value > 0
    assert found["lostmotion_windows_scored"][0].value > 0
    assert 20e6 < found["process_resident_memory_bytes"][0].value < 200e6
    assert found["process_cpu_seconds"][0].value > 0.1


def test_root_acknowledges_an_alarm_of_the_service(machine: Machine) -> None:
    """Another user's command reaches the running service through its database, whose files stay the service's own."""

    def states() -> list[str]:
        (joint,) = json.loads(machine.run(LOSTMOTION, "status", "--json"))["joints"]
        return [alarm["state"] for alarm in joint["alarms"]]

    machine.wait_until(lambda: "active" in states())
    machine.run(LOSTMOTION, "alarms", "ack", "elbow")
    machine.wait_until(lambda: states() == ["acknowledged"])
    owners = machine.run("sh", "-c", "stat -c %U /var/lib/lostmotion/history.db*")
    assert set(owners.split()) == {"lostmotion"}


def test_a_hanging_service_is_started_again(machine: Machine) -> None:
    """Stopped by SIGSTOP, it feeds no watchdog; systemd ends it, and the new one scores on."""
    before, kept = show(machine, "MainPID"), scores(machine)
    machine.run("sh", "-c", f"kill -STOP {before}")
    machine.wait_until(lambda: show(machine, "MainPID") not in (before, "0"))
    assert machine.said("Watchdog timeout")
    assert wait_for_scores(machine) > kept


def test_an_unplugged_robot_is_an_alarm_and_tried_anew(machine: Machine) -> None:
    """Without any device it says so as an error, once; after the watchdog's period systemd tries it with a new process,
    which scores on when they are back."""
    before, told = show(machine, "MainPID"), len(machine.said("cause=device severity=error event=raised"))
    machine.run("systemctl", "stop", "emulator")
    machine.wait_until(lambda: show(machine, "MainPID") not in (before, "0"))
    time.sleep(WATCHDOG_S / 2)
    assert len(machine.said("cause=device severity=error event=raised", "-p", ERROR)) > told
    asked = machine.journal("LOSTMOTION_KIND=alarm", "LOSTMOTION_JOINT=elbow", "LOSTMOTION_CAUSE=device")
    assert [entry["LOSTMOTION_EVENT"] for entry in asked].count("raised") == told + 1
    plug_in(machine)
    wait_for_scores(machine)


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
    machine.wait_until(lambda: machine.said("configuration taken: robot arm2, 1 joint"))
    assert show(machine, "MainPID") == before
    assert show(machine, "ActiveState") == "active"
    wait_for_scores(machine)


def test_a_bad_configuration_is_refused(machine: Machine) -> None:
    """systemctl reload fails and the log holds the line that names the key; the process is the same and scores on, also
    when it is signalled without the check."""
    before = show(machine, "MainPID")
    machine.write(CONFIG, TEXT.replace("rate_hz", "rate_hertz"))
    expected = f"{CONFIG}: accelerometer 'tip'.rate_hertz: unknown key; did you mean rate_hz?"
    assert "failed" in machine.run("systemctl", "reload", "lostmotion", check=False)
    assert machine.said(f"lostmotion: {expected}")
    machine.run("sh", "-c", f"kill -HUP {before}")
    machine.wait_until(lambda: machine.said(f"the old configuration stays: {expected}", "-p", ERROR))
    (line,) = machine.said(f"the old configuration stays: {expected}", "-p", ERROR)[-1:]
    (entry,) = [one for one in machine.journal("-p", ERROR) if one["MESSAGE"] == line][-1:]
    assert (entry["PRIORITY"], entry["_PID"]) == (ERROR, before)
    assert show(machine, "ActiveState") == "active"
    machine.write(CONFIG, TEXT)
    wait_for_scores(machine)
