"""The unit, the udev rules and the first configuration that ship with lostmotion; who could not start from where."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

from lostmotion.daemon import config as configuration
from lostmotion.daemon.metrics_http import MOST_CONNECTIONS
from lostmotion.daemon.unit import PAGE_UNIT, STATE, UNIT, Layout, ServiceError, check_reachable, template, unit_text

COMMAND = Path("/opt/lostmotion/bin/lostmotion")


def test_the_unit_runs_the_installed_command() -> None:
    """ExecStart is the given path, quoted and escaped by systemd's rules where it has to be."""
    assert f"\nExecStart={COMMAND} run --config /etc/lostmotion/lostmotion.toml\n" in unit_text(COMMAND, 252)
    assert '\nExecStart="/opt/my 50%% robot$$/lostmotion" run' in unit_text(Path("/opt/my 50% robot$/lostmotion"), 252)


@pytest.mark.parametrize("name", [UNIT, PAGE_UNIT])
def test_the_unit_names_pages_that_are_installed(name: str) -> None:
    """`systemctl status` lists them."""
    (pages,) = re.findall(r"^Documentation=(.+)$", unit_text(COMMAND, 252, name), re.MULTILINE)
    for page in pages.split():
        assert page.startswith("file:///")
        assert (
            Path(unquote(page.removeprefix("file://").replace("%%", "%"))).read_text(encoding="utf-8").startswith("#")
        )


@pytest.mark.parametrize(("version", "steps"), [(0, 0), (252, 0), (254, 2), (260, 2)])
def test_settings_are_those_that_systemd_knows(version: int, steps: int) -> None:
    """The growing pause between restarts came with systemd 254; an older one would complain about it."""
    assert len(re.findall(r"^Restart(?:Steps|MaxDelaySec)=", unit_text(COMMAND, version), re.MULTILINE)) == steps


@pytest.mark.parametrize("version", [0, 252, 254])
def test_files_and_threads_are_bounded(version: int) -> None:
    """All connections that Zenoh and the metrics take at most fit into LimitNOFILE beside 64 files of the service, as
    do the metrics' threads and 24 others into TasksMax; neither is without end."""
    zenoh = pytest.importorskip("zenoh")
    sessions = int(zenoh.Config().get_json("transport/unicast/max_sessions"))
    text = unit_text(COMMAND, version)
    limits = {name: re.findall(rf"^{name}=(\d+)$", text, re.MULTILINE) for name in ("LimitNOFILE", "TasksMax")}
    (files,), (tasks,) = ([int(number) for number in numbers] for numbers in limits.values())
    assert sessions + MOST_CONNECTIONS + 64 <= files <= 65536
    assert MOST_CONNECTIONS + 24 <= tasks <= 1024


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is missing")
@pytest.mark.parametrize(("name", "version"), [(UNIT, 252), (UNIT, 254), (PAGE_UNIT, 252)])
def test_exposure_is_small(tmp_path: Path, name: str, version: int) -> None:
    """systemd's own analysis of the file gives at most 1.5 of 10."""
    unit = tmp_path / name
    unit.write_text(unit_text(COMMAND, version, name))
    analysis = ["systemd-analyze", "security", "--offline=true", "--no-pager", unit]
    overall = subprocess.run(analysis, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    assert float(overall.split(": ")[1].split()[0]) <= 1.5


def test_the_first_configuration_is_valid(tmp_path: Path) -> None:
    """It needs no hardware and keeps its database where the service may write."""
    config = configuration.loads(template("lostmotion.toml"), "lostmotion.toml")
    assert [joint.driver for joint in config.joints] == ["simulated"]
    assert config.database.parent == STATE


def test_the_example_in_the_first_configuration_is_valid() -> None:
    """The tables that are commented out, taken instead of the simulated ones, are a valid configuration too."""
    text = template("lostmotion.toml")
    head, example = text[: text.index("[[accelerometer]]")], text[text.index("# [[accelerometer]]") :]
    hardware = "\n".join(line.removeprefix("# ").removeprefix("#") for line in example.splitlines())
    config = configuration.loads(head + hardware, "example")
    assert [joint.driver for joint in config.joints] == ["dynamixel"]


@pytest.mark.parametrize("folder", ["/home/me/env", "/root/env", "/run/user/1000/env", "/tmp/env"])
def test_a_program_that_the_service_cannot_see_is_refused(folder: str) -> None:
    """ProtectHome and PrivateTmp hide homes and temporary folders; the message says where to install instead."""
    with pytest.raises(ServiceError, match=r"below .* hidden from the service; expected .* python3 -m venv /opt"):
        check_reachable([Path(folder) / "bin/lostmotion"])


def test_a_program_that_others_may_not_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file or folder closed by a strict umask is named, with the command that opens it."""
    monkeypatch.setattr("lostmotion.daemon.unit.HIDDEN", ())  # the test's own folder may be below /tmp
    folder = tmp_path / "env"
    folder.mkdir(0o700)
    program = folder / "lostmotion"
    for mode, closed in ((0o750, program), (0o755, folder)):
        program.touch()
        program.chmod(mode)
        with pytest.raises(ServiceError, match=f"^{closed}: found closed .*chmod -R a\\+rX {closed}$"):
            check_reachable([program])


def lostmotion(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The installed command."""
    return subprocess.run([Path(sys.executable).parent / "lostmotion", *arguments], capture_output=True, text=True)


def test_print_shows_the_unit() -> None:
    """`service install --print` puts the unit on stdout and changes nothing, for any user, with or without systemd."""
    done = lostmotion("service", "install", "--print")
    assert done.stdout.startswith("# Runs lostmotion on a robot.")
    assert f"\nExecStart={Path(sys.executable).parent}/lostmotion run --config" in done.stdout
    both = lostmotion("service", "install", "--print", "--web").stdout
    assert re.findall(r"^(?:# /etc/systemd/.*|ExecStart=\S+ \w+)", both, re.MULTILINE) == [
        "# /etc/systemd/system/lostmotion.service",
        f"ExecStart={Path(sys.executable).parent}/lostmotion run",
        "# /etc/systemd/system/lostmotion-web.service",
        f"ExecStart={Path(sys.executable).parent}/lostmotion web",
    ]


@pytest.mark.skipif(Path("/run/systemd/system").is_dir(), reason="this machine runs systemd")
@pytest.mark.parametrize("command", ["install", "uninstall"])
def test_without_systemd_it_says_so(command: str) -> None:
    """One line, exit status 2: what was found, what was expected, what to do instead."""
    done = lostmotion("service", command, "--dry-run")
    assert done.returncode == 2
    assert done.stderr.startswith("lostmotion: found no systemd (/run/systemd/system is missing), expected")
    assert done.stderr.count("\n") == 1


@pytest.mark.skipif(shutil.which("systemctl") is None, reason="no systemctl")
def test_an_image_is_cleared_of_the_service(tmp_path: Path) -> None:
    """`service uninstall --root` disables and removes what is below the folder, without a running systemd; the
    configuration stays, until it is purged."""
    layout = Layout(tmp_path)
    for path, text in ((layout.unit, unit_text(Path("/opt/lostmotion"), 252)), (layout.rules, ""), (layout.config, "")):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    wanted = layout.unit.parent / "multi-user.target.wants" / layout.unit.name
    subprocess.run(["systemctl", f"--root={tmp_path}", "enable", layout.unit.name], check=True, capture_output=True)
    assert wanted.is_symlink()
    done = lostmotion("service", "uninstall", "--root", str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert not any(path.exists() or path.is_symlink() for path in (layout.unit, layout.rules, wanted))
    assert done.stdout.splitlines()[-1] == f"kept: {layout.config.parent}; uninstall --purge removes them"
    lostmotion("service", "uninstall", "--root", str(tmp_path), "--purge")
    assert not layout.config.parent.exists()


def test_what_is_not_installed_is_told(tmp_path: Path) -> None:
    """Nothing to remove is no error, and no silence."""
    done = lostmotion("service", "uninstall", "--root", str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"not installed: there is no {Layout(tmp_path).unit}\n"
