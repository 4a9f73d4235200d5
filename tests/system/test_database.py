"""The database's bad days: damage, an upgrade, the way back."""

from __future__ import annotations

import pytest

from tests.system.conftest import Boot
from tests.system.image import VENV
from tests.system.machine import Machine
from tests.system.robot import LOSTMOTION, install_with_robot, plug_in, show, wait_for_scores

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first one may build the image

FOLDER = "/var/lib/private/lostmotion"
DATABASE = f"{FOLDER}/history.db"
OLD = f"""
import sqlite3
from lostmotion.daemon.migrations import MIGRATIONS
db = sqlite3.connect("{DATABASE}")
for script in MIGRATIONS[:2]:
    db.executescript(script)
db.executescript("PRAGMA user_version = 2; INSERT INTO joint (name) VALUES ('wrist')")
"""


@pytest.fixture
def machine(boot: Boot) -> Machine:
    """The service runs and has scored."""
    machine = boot()
    install_with_robot(machine)
    wait_for_scores(machine)
    return machine


def python(machine: Machine, script: str) -> str:
    """What a script prints, run by lostmotion's own Python."""
    return machine.run(f"{VENV}/bin/python", "-c", script)


def damage(machine: Machine) -> None:
    """Overwrites all pages of the database behind the first."""
    size = int(machine.run("stat", "-c", "%s", DATABASE))
    machine.run("sh", "-c", f"head -c {size - 4096} /dev/zero | tr '\\0' '\\377' | "
                f"dd of={DATABASE} bs=4096 seek=1 conv=notrunc status=none")  # fmt: skip


def test_a_database_damaged_at_rest_is_moved_aside(machine: Machine) -> None:
    """The service starts all the same, scores into a new one, and says so as an error."""
    machine.run("systemctl", "stop", "lostmotion")
    damage(machine)
    machine.run("systemctl", "start", "lostmotion")
    (line,) = machine.said("a new history begins", "-p", "err")
    assert "lostmotion/history.db: is damaged" in line
    assert "history.db.damaged-" in machine.run("ls", FOLDER)
    wait_for_scores(machine)


def test_a_database_damaged_in_use_is_moved_aside(machine: Machine) -> None:
    """The same process goes on in a new one, and says so as an error."""
    machine.run("systemctl", "stop", "lostmotion", "emulator")  # nothing to write: no page is in memory yet
    machine.run("systemctl", "start", "lostmotion")
    before = show(machine, "MainPID")
    damage(machine)
    plug_in(machine)
    machine.wait_until(lambda: machine.said("a new history begins", "-p", "err"))
    wait_for_scores(machine)
    assert show(machine, "MainPID") == before


def test_upgrade_and_way_back(boot: Boot) -> None:
    """An old database is copied and changed; a program that is too old names that copy, which works in its place."""
    machine = boot()
    machine.run("mkdir", "-p", "-m", "700", "/var/lib/private")
    machine.run("mkdir", FOLDER)
    python(machine, OLD)
    install_with_robot(machine)
    assert machine.said("schema version 2 becomes", "-p", "warning")
    wait_for_scores(machine)
    machine.run("systemctl", "stop", "lostmotion")
    python(machine, f"import sqlite3; sqlite3.connect('{DATABASE}').execute('PRAGMA user_version = 99')")
    refused = machine.run(LOSTMOTION, "service", "install", check=False).splitlines()[-1]
    assert refused.startswith("lostmotion: installed, but it does not start: ")
    assert "found schema version 99, expected at most" in refused
    assert "or go back to history.db.version2 beside it" in refused
    machine.run("sh", "-c", f"systemctl stop lostmotion; cd {FOLDER}; mkdir newer; mv history.db newer")
    machine.run("mv", f"{DATABASE}.version2", DATABASE)
    machine.run("systemctl", "start", "lostmotion")
    joints = python(machine, f"import sqlite3; print(*sqlite3.connect('{DATABASE}').execute('SELECT name FROM joint'))")
    assert "('wrist',)" in joints
    wait_for_scores(machine)


def test_the_history_continues_on_another_computer(machine: Machine) -> None:
    """The commands of docs/installing.md, with files of a user whom the new computer does not know."""
    machine.run("systemctl", "stop", "lostmotion", "emulator")
    count = "import sqlite3; print(sqlite3.connect('%s').execute('SELECT count(*) FROM scores').fetchone()[0])"
    before = int(python(machine, count % DATABASE))
    machine.run("chown", "-R", "64000:64000", FOLDER)
    machine.run("tar", "-C", "/", "-czf", "/root/lostmotion.tgz", "var/lib/private/lostmotion", "etc/lostmotion")
    machine.run(LOSTMOTION, "service", "uninstall", "--purge")
    install_with_robot(machine)
    machine.run("systemctl", "stop", "lostmotion")
    machine.run("tar", "-C", "/", "-xzf", "/root/lostmotion.tgz")
    machine.run("systemctl", "start", "lostmotion")
    machine.wait_until(lambda: int(python(machine, count % DATABASE)) > before + 5)
    assert not machine.said("a new history begins", "-p", "err")
