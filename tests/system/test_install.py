"""Installing and removing the service on a machine that has never seen it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from examples.zenoh import certificates

from tests.conftest import ROOT
from tests.system.conftest import Boot
from tests.system.image import VENV
from tests.system.machine import Machine
from tests.system.robot import CONFIG, LOSTMOTION, show

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first one may build the image

EXPOSURE = 1.5
COMPILE_S = 180.0
UNITS = ("lostmotion", "lostmotion-web")
BROWSER = """
import json, time, urllib.request
def ask(path, body=None, **headers):
    request = urllib.request.Request("http://127.0.0.1:8737" + path, body, headers)
    return urllib.request.urlopen(request, timeout=50).read().decode()
token = ask("/").split('name="csrf" content="')[1].split('"')[0]
wish = {"verb": "begin", "joint": "elbow", "step": "motion"}
print(json.loads(ask("/api/calibrate", json.dumps(wish).encode(), **{"X-CSRF-Token": token}))["step"])
time.sleep(3)
ask("/api/calibrate", json.dumps({"verb": "end"}).encode(), **{"X-CSRF-Token": token})
"""
KEYS = "/etc/lostmotion/zenoh"
ROUTER = f"""
import threading, zenoh
session = zenoh.open(zenoh.Config.from_file("{KEYS}/router.json5"))
threading.Event().wait()
"""


@pytest.fixture(scope="module")
def machine(boot: Boot) -> Machine:
    """The service as `service install` leaves it, on the simulated robot."""
    machine = boot()
    machine.run(LOSTMOTION, "service", "install")
    return machine


def test_it_runs_now_and_after_the_next_start(machine: Machine) -> None:
    """The unit is active and enabled; install said what it did."""
    assert machine.run("systemctl", "is-active", "lostmotion").strip() == "active"
    assert machine.run("systemctl", "is-enabled", "lostmotion").strip() == "enabled"


def test_the_simulated_robot_is_scored_under_all_the_hardening(machine: Machine) -> None:
    """The first configuration works as it is: scores of the elbow arrive in /var/lib/lostmotion."""

    def health() -> dict[str, object]:
        """The only joint's; empty until its first row is on the disk."""
        return {key: value for joint in json.loads(machine.run(LOSTMOTION, "status", "--json"))["joints"]
                for key, value in joint.items()}  # fmt: skip

    machine.wait_until(lambda: health().get("last_window"), COMPILE_S)
    assert health()["name"] == "elbow"
    assert machine.run("ls", "/var/lib/lostmotion/history.db").strip()


def recorded(machine: Machine) -> bool:
    """Whether the page's wish for a recording was heard, and there are samples in it."""
    said = machine.run(f"{VENV}/bin/python", "-c", BROWSER, check=False)
    there = machine.run("sh", "-c", "cat /var/lib/lostmotion/recordings/*.csv | wc -l", check=False)
    return said.strip() == "motion" and there.strip().isdecimal() and int(there) > 100


def test_the_page_is_a_service_beside_it(machine: Machine) -> None:
    """``--web`` brings the page: the same user, hardened; it sees the service's private database, and the service
    records a joint when the page asks."""
    machine.run(LOSTMOTION, "service", "install", "--web")
    machine.wait_until(lambda: recorded(machine), COMPILE_S)
    status = [machine.run("cat", f"/proc/{show(machine, 'MainPID', unit)}/status") for unit in UNITS]
    users = {re.findall(r"^Uid:\t(\d+)", text, re.MULTILINE)[0] for text in status}
    assert len(users) == 1
    assert int(users.pop()) >= 61184
    overall = machine.run("systemd-analyze", "security", "lostmotion-web", "--no-pager").splitlines()[-1]
    assert float(overall.split(": ")[1].split()[0]) <= EXPOSURE


def test_its_user_is_its_own(machine: Machine) -> None:
    """The process is no root, has no capability, and the data is closed to others."""
    status = machine.run("cat", f"/proc/{show(machine, 'MainPID')}/status")
    fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    assert int(fields["Uid"].split()[0]) >= 61184  # systemd's range of dynamic users
    assert int(fields["CapEff"], 16) == 0
    assert machine.run("stat", "-c", "%a", "/var/lib/private").strip() == "700"


def test_exposure_is_small(machine: Machine) -> None:
    """systemd's own analysis gives at most 1.5 of 10."""
    overall = machine.run("systemd-analyze", "security", "lostmotion", "--no-pager").splitlines()[-1]
    assert float(overall.split(": ")[1].split()[0]) <= EXPOSURE


def test_udev_reads_the_rules(machine: Machine) -> None:
    """udev takes the file without a complaint."""
    told = machine.run("udevadm", "test", "/sys/class/mem/null", check=False)
    assert "Reading rules file: /etc/udev/rules.d/70-lostmotion.rules" in told
    assert not [line for line in told.splitlines() if "70-lostmotion.rules:" in line]


def test_once_more_keeps_the_configuration(machine: Machine) -> None:
    """A second install, as after an upgrade, starts the service anew and leaves the configuration alone."""
    machine.write(CONFIG, machine.run("cat", CONFIG) + "# mine\n")
    before = show(machine, "MainPID")
    machine.run(LOSTMOTION, "service", "install")
    assert "# mine" in machine.run("cat", CONFIG)
    assert show(machine, "MainPID") not in (before, "0")


def test_a_wrong_configuration_stops_it_before_anything_changes(machine: Machine) -> None:
    """One line names the key; the service that runs is left alone."""
    good, before = machine.run("cat", CONFIG), show(machine, "MainPID")
    machine.write(CONFIG, good.replace("play_m", "plya_m"))
    told = machine.run(LOSTMOTION, "service", "install", check=False)
    machine.write(CONFIG, good)
    assert told.startswith(f"lostmotion: {CONFIG}: joint 'elbow'.plya_m: unknown key; did you mean play_m?")
    assert told.count("\n") == 1
    assert show(machine, "MainPID") == before


@pytest.fixture
def router(machine: Machine, tmp_path: Path) -> Machine:
    """The machine with the files of examples/zenoh, certificates, and a router that lets in nobody without one."""
    certificates.main([str(tmp_path), "arm1", "office"])
    for file in (*tmp_path.iterdir(), *(ROOT / "examples" / "zenoh").glob("*.json5")):
        machine.write(f"{KEYS}/{file.name}", file.read_text())
    machine.run("sh", "-c", f"chmod 600 {KEYS}/*.key")
    machine.write("/etc/hosts", "127.0.0.1 localhost\n")
    machine.write("/opt/router.py", ROUTER)
    machine.run("systemd-run", "--unit=router", f"{VENV}/bin/python", "/opt/router.py")
    machine.wait_until(lambda: "no robot there" in ask_fleet(machine))
    return machine


def ask_fleet(machine: Machine) -> str:
    """What an operator with a certificate is told."""
    return machine.run(LOSTMOTION, "fleet", "status", "--zenoh", f"{KEYS}/operator.json5", "--json", check=False)


def test_a_key_of_roots_is_handed_over(router: Machine) -> None:
    """Nobody but root may read the robot's key: no session; with the drop-in of docs/alarms.md there is one."""
    page = (ROOT / "docs" / "alarms.md").read_text()
    ((drop_in,), (path,)) = (re.findall(what, page) for what in (r"```ini\n([^`]*)```", r'"(/run/credentials/.*)"'))
    robot = router.run("cat", CONFIG).replace('"simulated"', '"arm1"', 1)
    router.write(CONFIG, f'{robot}[alarm.zenoh]\nconfig = "{KEYS}/robot.json5"\n')
    router.run("systemctl", "restart", "lostmotion")
    router.wait_until(lambda: router.said("zenoh: session not open", "-p", "warning"))

    router.write("/etc/systemd/system/lostmotion.service.d/override.conf", drop_in)
    router.run("sed", "-i", f"s|{KEYS}/arm1.key|{path}|", f"{KEYS}/robot.json5")
    router.run("systemctl", "daemon-reload")
    router.run("systemctl", "restart", "lostmotion")
    router.wait_until(lambda: router.said("zenoh: session open"))
    assert [one["robot"] for one in json.loads(ask_fleet(router))["robots"]] == ["arm1"]
    assert router.run("stat", "-c", "%U %a", f"{KEYS}/arm1.key") == "root 600\n"


def test_a_program_in_a_home_is_refused(boot: Boot) -> None:
    """A command below /home, which the service could not see, is told in one line, and nothing is written."""
    machine = boot()
    machine.run("sh", "-c", "mkdir -p /home/me/env && mount --bind /opt/lostmotion /home/me/env")
    told = machine.run("/home/me/env/bin/python", "/home/me/env/bin/lostmotion", "service", "install", check=False)
    assert "below /home, which is hidden from the service" in told
    assert told.count("\n") == 1
    assert "lostmotion" not in machine.run("ls", "/etc/systemd/system")


def test_uninstall_keeps_the_data_and_purge_does_not(boot: Boot) -> None:
    """After uninstall no unit is left but configuration and database are; after --purge nothing is."""
    machine = boot()
    machine.run(LOSTMOTION, "service", "install")
    told = machine.run(LOSTMOTION, "service", "uninstall")
    assert told.splitlines()[-1] == "kept: /etc/lostmotion, /var/lib/lostmotion; uninstall --purge removes them"
    assert machine.run("systemctl", "is-active", "lostmotion", check=False).strip() == "inactive"
    assert not machine.run("sh", "-c", "ls -d /etc/systemd/system/*/lostmotion* /etc/*/*/*lostmotion* 2>&-; true")
    assert "history.db" in machine.run("ls", "/var/lib/lostmotion/")
    machine.run(LOSTMOTION, "service", "uninstall", "--purge")
    assert not machine.run(
        "sh", "-c", "ls -d /etc/lostmotion /var/lib/lostmotion /var/lib/private/lostmotion 2>&-; true"
    )
