"""The edge of the program: help, usage errors, exit statuses, signals, what is imported when."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
import tomllib
from contextlib import closing
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from lostmotion import __version__
from lostmotion.daemon.commands.guard import RootGroup
from tests.conftest import ROOT
from tests.daemon.cli_world import HARDWARE, PROGRAM, SIMULATED, call, fill, is_one_line, start
from tests.daemon.conftest import wait_until

HEAVY = ("numpy", "scipy", "numba", "matplotlib", "rich", "plotext", "serial", "zenoh")
COMMANDS = (
    "alarms",
    "calibrate",
    "config",
    "doctor",
    "effects",
    "export",
    "fleet",
    "history",
    "import",
    "lab",
    "record",
    "run",
    "score",
    "service",
    "simulate",
    "status",
    "trend",
    "web",
)


def imported_by(*arguments: str, folder: Path) -> set[str]:
    """Which heavy packages a call of the program has loaded when it ends."""
    code = (
        "import sys\nfrom lostmotion.daemon.cli import main\n"
        f"sys.argv[1:] = {list(arguments)}\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"print('\\nLOADED', *[name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=60)
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("group", [[], ["alarms"], ["calibrate"], ["config"], ["fleet"], ["service"]])
def test_help_says_what_each_command_does(group: list[str]) -> None:
    """In a list of commands no description is cut off, at 80 columns."""
    listed = call(*group, "--help").stdout.partition("Commands:")[2].splitlines()[1:]
    assert listed
    assert [line for line in listed if line.endswith("...") or not line.endswith(".")] == []


def test_help_lists_every_command() -> None:
    """`lostmotion --help` names all commands, those of the lab too, and no other."""
    result = call("--help")
    listed = [line.split()[0] for line in result.stdout.partition("Commands:")[2].splitlines() if line.strip()]
    assert result.exit_code == 0
    assert listed == list(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str) -> None:
    """Each command explains itself and says in one line what it does."""
    result = call(command, "--help")
    assert result.exit_code == 0
    assert result.stdout.startswith("Usage: lostmotion " + command)


@pytest.mark.parametrize("group", [[], ["calibrate"], ["config"], ["fleet"], ["lab"], ["service"]])
def test_a_call_without_a_command_is_one_line(group: list[str]) -> None:
    """It names the commands that there are; the help is where it is asked for."""
    listed = [line.split()[0] for line in call(*group, "--help").stdout.partition("Commands:")[2].splitlines()[1:]]
    result = call(*group)
    assert (result.exit_code, result.stdout) == (2, "")
    path = " ".join(["lostmotion", *group])
    expected = f"lostmotion: found no command, expected one of {', '.join(listed)}; see {path} --help\n"
    assert result.stderr == expected


def test_version() -> None:
    """`--version` prints name and version."""
    assert call("--version").stdout == f"lostmotion {__version__}\n"


def test_the_package_is_a_program(tmp_path: Path) -> None:
    """`python -m lostmotion` is the command."""
    done = subprocess.run(
        [sys.executable, "-m", "lostmotion", "--version"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"lostmotion {__version__}\n"


@pytest.mark.parametrize("command", [[], ["lab"], ["lab", "explain"], ["simulate"], ["effects"]], ids=" ".join)
def test_help_imports_nothing_heavy(command: list[str], tmp_path: Path) -> None:
    """Not even NumPy is loaded for the help, nor by the shell's completion, which makes the same commands."""
    assert imported_by(*command, "--help", folder=tmp_path) == set()


def test_a_motion_in_closed_form_needs_no_spline(tmp_path: Path) -> None:
    """A simulation loads numba, and of SciPy only what numba asks for: ``scipy.interpolate`` alone takes as long."""
    code = (
        "import sys\nfrom lostmotion.daemon.cli import main\nsys.argv[1:] = ['simulate', 'joint', '--motion', 'sine:1',"
        " '-o', 'a.csv', '--duration', '0.1']\ntry: main()\nexcept SystemExit as end: print(end.code)\n"
        "print('numba' in sys.modules, 'scipy.interpolate' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout.split()[-3:] == ["0", "True", "False"], done.stderr


def test_run_on_hardware_loads_no_heavy_package(tmp_path: Path) -> None:
    """The service on serial ports runs without SciPy, numba, plots or tables in memory."""
    (tmp_path / "robot.toml").write_text(HARDWARE)
    loaded = imported_by("run", "--config", "robot.toml", "--duration", "0.3", folder=tmp_path)
    assert (tmp_path / "history.db").exists()
    assert loaded == {"numpy", "serial"}


def test_reading_loads_no_science(tmp_path: Path) -> None:
    """`history --json` loads neither tables nor plots."""
    fill(tmp_path / "h.db", 5)
    assert imported_by("history", "elbow", "--json", "--database", "h.db", folder=tmp_path) <= {"numpy"}


def test_unknown_command_suggests_the_near_one() -> None:
    """A slip of the finger is one line with the right name."""
    assert is_one_line(call("histroy", "elbow"), "histroy", "did you mean history? See lostmotion --help")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["status", "--jsno"], ["--jsno", "--json"]),
        (["history"], ["JOINT", "lostmotion history --help"]),
        (["history", "elbow", "--limit", "0"], ["--limit", "0"]),
        (["history", "elbow", "--since", "yesterday"], ["yesterday", "30d"]),
        (["history", "elbow", "--csv", "--json"], ["--csv", "--json"]),
        (["run", "--duration", "nan"], ["nan", "above 0"]),
        (["run", "--duration", "-1"], ["-1", "above 0"]),
        (["run", "--config", "none.toml"], ["none.toml", "No such file"]),
        (["record", "--config", "x.toml", "--duration", "1"], ["--output"]),
    ],
)
def test_wrong_call_is_one_line(arguments: list[str], words: list[str]) -> None:
    """Whatever is wrong with a call: status 2, nothing on stdout, one line on stderr that says what."""
    assert is_one_line(call(*arguments), *words)


def broken_program() -> RootGroup:
    """A program of one command that has a bug."""
    group = RootGroup()

    @group.command()
    def crash() -> None:
        raise ZeroDivisionError("deep\ninside")

    @group.command()
    def interrupt() -> None:
        raise KeyboardInterrupt

    @group.command()
    def write() -> None:
        Path("/no/such/folder/x").write_text("")

    return group


def test_a_long_word_is_not_repeated_whole() -> None:
    answer = call("histroy" + 50_000 * "y")
    assert is_one_line(answer, "histroyyy", "... expected")
    assert len(answer.stderr) < 5000


def test_bug_shows_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unexpected exception is one line that tells how to see more."""
    monkeypatch.delenv("LOSTMOTION_DEBUG", raising=False)
    assert is_one_line(CliRunner().invoke(broken_program(), ["crash"]), "internal error", "deep inside", "DEBUG")


def test_debug_shows_the_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """LOSTMOTION_DEBUG=1 brings the traceback, and the same status."""
    monkeypatch.setenv("LOSTMOTION_DEBUG", "1")
    result = CliRunner().invoke(broken_program(), ["crash"])
    assert result.exit_code == 2
    assert "Traceback" in result.stderr


def test_error_of_the_system_names_the_file() -> None:
    """An OSError that nobody foresaw still says which file and why."""
    assert is_one_line(CliRunner().invoke(broken_program(), ["write"]), "/no/such/folder/x", "No such file")


def test_interrupt_is_quiet() -> None:
    """Ctrl-C ends a command with status 130 and no word."""
    result = CliRunner().invoke(broken_program(), ["interrupt"])
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "")


def test_group_may_be_any_click_group() -> None:
    """The guard wraps plain click commands, so that the lab's need not know it."""
    group = RootGroup()
    group.add_command(click.Command("three", callback=lambda: 1))
    assert CliRunner().invoke(group, ["three"]).exit_code == 1


def test_reader_that_goes_away(tmp_path: Path) -> None:
    """`| head` ends the program without a complaint."""
    fill(tmp_path / "h.db", 3000)
    process = start("history", "elbow", "--csv", "--database", "h.db", folder=tmp_path)
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline().startswith("time,score,level")
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(60) == 141
    process.stderr.close()


def test_full_disk_under_stdout(tmp_path: Path) -> None:
    """Output that cannot be written is an error, not a success."""
    fill(tmp_path / "h.db", 5)
    with Path("/dev/full").open("w") as full:
        command = [*PROGRAM, "history", "elbow", "--json", "--database", "h.db"]
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "lostmotion: No space left on device\n"


def test_full_disk_under_stderr() -> None:
    """An error that cannot be told has status 2 all the same: 1 would be an alarm of `status --fail`."""
    with Path("/dev/full").open("w") as full:
        assert subprocess.run([*PROGRAM, "status", "--bogus"], stdout=full, stderr=full, timeout=60).returncode == 2


def test_interrupt_while_it_loads_is_quiet() -> None:
    """Ctrl-C in the first moments, while Python still imports: status 130 and no traceback."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module, _, name = project["scripts"]["lostmotion"].partition(":")
    code = (
        "import sys\nclass Interrupted:\n def find_spec(self, name, *rest):\n"
        "  if name == 'click': raise KeyboardInterrupt\n"
        f"sys.meta_path.insert(0, Interrupted())\nfrom {module} import {name}\n{name}()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["history", "elbow", "--json", "--database", "h.db"], ["effects"]])
def test_closed_stdout(tmp_path: Path, arguments: list[str]) -> None:
    """`>&-` is one line and status 2, whether a command prints JSON or a table."""
    fill(tmp_path / "h.db", 5)
    command = ["sh", "-c", 'exec "$@" >&-', "sh", *PROGRAM, *arguments]
    done = subprocess.run(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "lostmotion: stdout is closed, expected to be open for the output\n"


def test_a_service_without_stderr_keeps_no_log(tmp_path: Path) -> None:
    """`2>&-`: the log goes nowhere, neither into memory for years nor into the next file that is opened."""
    (tmp_path / "robot.toml").write_text(HARDWARE)
    command = ["sh", "-c", 'exec "$@" 2>&-', "sh", *PROGRAM, "run", "--config", "robot.toml", "--duration", "2"]
    with subprocess.Popen(command, cwd=tmp_path) as process:
        wait_until((tmp_path / "history.db").exists)
        assert Path(f"/proc/{process.pid}/fd/2").resolve() == Path(os.devnull)
        assert process.wait(60) == 0


def test_run_tells_where_the_database_is(tmp_path: Path) -> None:
    """The service's first word names the robot and the database, with the time in UTC; stdout stays empty."""
    (tmp_path / "robot.toml").write_text(HARDWARE)
    process = start("run", "--config", "robot.toml", "--duration", "0.2", folder=tmp_path)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert out == ""
    line = r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d\d\dZ INFO    started: robot arm2, 1 joint, database "
    line += re.escape(str(tmp_path / "history.db"))
    assert any(re.fullmatch(line, said) for said in err.splitlines()), err


@pytest.mark.slow
def test_run_that_cannot_start_says_so_in_one_line(tmp_path: Path) -> None:
    """Another program's database and a folder in its place: status 2, and one line in all on stderr."""
    (tmp_path / "folder").mkdir()
    with closing(sqlite3.connect(tmp_path / "photos.db")) as photos:
        photos.execute("CREATE TABLE photo (name)")
    for path, words in (("folder", "found a directory, folder"), ("photos.db", "database of another program")):
        (tmp_path / "robot.toml").write_text(HARDWARE.replace("history.db", path))
        process = start("run", "--config", "robot.toml", "--duration", "0.2", folder=tmp_path)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out, err.count("\n")) == (2, "", 1), err
        assert words in err


@pytest.mark.slow
def test_interrupted_recording_is_valid(tmp_path: Path) -> None:
    """Ctrl-C ends `record` with status 130; what was measured until then can be scored."""
    (tmp_path / "robot.toml").write_text(SIMULATED.replace('"max"', "4.0"))
    process = start("record", "--config", "robot.toml", "--duration", "600", "-o", "r.csv", folder=tmp_path)
    recording, deadline = tmp_path / "r.csv", time.monotonic() + 120
    while time.monotonic() < deadline and not (recording.exists() and recording.stat().st_size > 60_000):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "rows of joint elbow" in err
    assert "Traceback" not in err
    windows = json.loads(call("score", recording, "--json").stdout)["windows"]
    assert len(windows) >= 2


def test_one_thread_for_small_matrices() -> None:
    """The program asks for it before numpy is imported, and leaves alone what the user has set."""
    script = "import sys, os; from lostmotion.daemon import cli; assert 'numpy' not in sys.modules; "
    script += "cli.cli.main = lambda: print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules); cli.main()"
    for given, used in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        own = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | given
        done = subprocess.run([sys.executable, "-c", script], env=own, capture_output=True, text=True, check=True)
        assert done.stdout.split() == [used, "False"]


def test_of_a_file_that_is_refused_there_is_one_line(tmp_path: Path) -> None:
    """And none of NumPy's warnings about its values."""
    path = tmp_path / "empty.csv"
    path.write_text("time,command,position\n" + "".join(f"{k / 100},nan,nan\n" for k in range(50)))
    command = [sys.executable, "-m", "lostmotion", "import", str(path), "-o", str(tmp_path / "o.csv")]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1, found.stderr
