"""Jobs in processes of their own: one at a time, stopped with all their processes, bounded, found again."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from lostmotion.web.jobs import BusyError, FullError, Job, JobError, Jobs, Limits
from tests.daemon.conftest import wait_until

FOREVER = [sys.executable, "-c", "import time; print('here', flush=True); time.sleep(600)"]


def python(text: str) -> list[str]:
    """A command that runs a line of Python."""
    return [sys.executable, "-c", text]


def begin(jobs: Jobs, *steps: list[str]) -> str:
    """Starts a job of those commands."""
    return jobs.start(jobs.new(), steps, jobs.folder, {"title": "a test"})


def ended(jobs: Jobs, name: str) -> Job:
    """The job when it is over."""
    wait_until(lambda: jobs.find(name).state != "running" and jobs.running() is None, 60)
    return jobs.find(name)


@pytest.fixture
def jobs(tmp_path: Path) -> Jobs:
    """Jobs of an empty folder."""
    return Jobs(tmp_path / "runs")


def test_a_job_runs_its_commands_and_leaves_what_they_say(jobs: Jobs) -> None:
    """Two commands, one after the other: the last one's output is the result, what went to stderr is the progress."""
    telling = 'import sys; print(\'{"progress": "half", "part": 0.5}\', file=sys.stderr); print(\'{"answer": 42}\')'
    name = begin(jobs, python("open('first', 'w')"), python(f"open('first'); {telling}"))
    job = ended(jobs, name)
    assert (job.state, job.text, job.about) == ("done", "", {"title": "a test"})
    assert job.progress == [{"progress": "half", "part": 0.5}]
    assert jobs.path(name, "result.json").read_text() == '{"answer": 42}\n'
    assert job.began is not None
    assert job.ended is not None
    assert job.ended >= job.began
    assert jobs.running() is None


def test_one_at_a_time(jobs: Jobs) -> None:
    """A second job is refused in words while the first is under way, also by another server, and leaves no trace."""
    first = begin(jobs, FOREVER)
    other = Jobs(jobs.folder)
    with pytest.raises(BusyError, match="under way"):
        begin(other, FOREVER)
    assert [job.id for job in other.all()] == [first]
    other.stop(first)
    assert ended(other, begin(other, python("pass"))).state == "done"


def test_a_stop_ends_all_its_processes(jobs: Jobs) -> None:
    """Also those that a command has started itself."""
    child = f"import subprocess; p = subprocess.Popen({FOREVER!r}); print(p.pid, flush=True); p.wait()"
    name = begin(jobs, python(child))
    result = jobs.folder / name / "result.json"
    wait_until(lambda: result.exists() and "here" in result.read_text(), 60)
    pid = int(result.read_text().split()[0])
    os.kill(pid, 0)
    jobs.stop(name)
    wait_until(lambda: not is_alive(pid), 60)
    assert jobs.find(name).state == "stopped"
    jobs.stop(name)
    jobs.remove(name)
    with pytest.raises(JobError, match="has it been removed"):
        jobs.find(name)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_runner_that_is_killed_is_said(jobs: Jobs) -> None:
    """Nothing is under way then, and the next one can begin."""
    name = begin(jobs, python("pass"), FOREVER)
    wait_until(lambda: (jobs.folder / name / "result.json").exists(), 60)
    held = jobs.running()
    assert held is not None
    os.killpg(held[1], 9)
    job = ended(jobs, name)
    assert job.state == "interrupted"
    assert "interrupted" in job.text
    assert ended(jobs, begin(jobs, python("pass"))).state == "done"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (python("import time; time.sleep(600)"), "longer than"),
        (python("x = bytearray(400_000_000)"), "MemoryError"),
        (python("raise SystemExit('lostmotion: found a cat, expected a dog')"), "found a cat, expected a dog"),
        (python("import os; os.kill(os.getpid(), 11)"), "SIGSEGV"),
    ],
)
def test_what_goes_wrong_is_said(tmp_path: Path, command: list[str], words: str) -> None:
    """Too long, too large, a complaint, a crash: one sentence each, and nothing is under way any more."""
    time_s = 1.0 if "sleep" in command[-1] else 60.0
    jobs = Jobs(tmp_path / "runs", Limits(time_s=time_s, memory_bytes=200_000_000))
    job = ended(jobs, begin(jobs, command))
    assert job.state == "failed"
    assert words in job.text
    assert "\n" not in job.text
    wait_until(lambda: jobs.running() is None, 60)


def test_a_stamp_changes_with_what_is_told(jobs: Jobs) -> None:
    """And not without."""
    name = begin(jobs, python("import sys, time; time.sleep(1); print('x', file=sys.stderr); time.sleep(600)"))
    wait_until(lambda: (jobs.folder / name / "log").exists(), 60)
    before = jobs.stamp(name)
    end = time.monotonic() + 60
    while jobs.stamp(name) == before and time.monotonic() < end:
        time.sleep(0.05)
    after = jobs.stamp(name)
    assert after != before
    assert jobs.stamp(name) == after
    jobs.stop(name)
    assert jobs.stamp(name) != after


def test_a_full_disk_takes_no_job(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said in words, and no folder is left."""
    monkeypatch.setattr("lostmotion.web.jobs.LEAST_FREE", 10**18)
    with pytest.raises(FullError, match="nearly full"):
        jobs.new()
    assert jobs.all() == list(jobs.folder.iterdir()) == []


@pytest.mark.parametrize("name", ["..", "../..", "20260101T000000-abcdef", "", "x" * 500, "20260101T000000-abcdef/.."])
def test_a_name_from_outside_leads_nowhere(jobs: Jobs, name: str) -> None:
    """Only the folders of jobs are jobs."""
    begin_and_wait = ended(jobs, begin(jobs, python("pass")))
    assert begin_and_wait.state == "done"
    for act in (jobs.find, jobs.stop, jobs.remove):
        with pytest.raises(JobError):
            act(name)
