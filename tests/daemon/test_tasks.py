"""What other processes ask of a running service: a recording, another configuration."""

from __future__ import annotations

import signal
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lostmotion.daemon.records import Answer, Request, Task
from lostmotion.daemon.requests import ask, wait
from lostmotion.daemon.tasks import KEPT, recording_path
from lostmotion.detector.taps import find_taps, pooled
from lostmotion.drivers.emulator import CsvStream, Emulator, ServoLine, Taps
from lostmotion.drivers.recording import read_recording
from tests.daemon.conftest import Running, start, wait_until
from tests.daemon.test_service import hardware

__all__ = ["start"]


def asked(database: Path, task: Task, joint: str = "", for_s: float = 0.0) -> tuple[int, Answer]:
    """A request to the running service: its number and the answer."""
    number = ask(database, Request(0, joint, task, for_s=for_s, by="test"), datetime.now(UTC))
    answer = wait(database, number, 60.0)
    assert answer is not None
    return number, answer


def rows(path: Path) -> int:
    """How many lines of samples a recording has by now."""
    return path.read_bytes().count(b"\n") - 15 if path.exists() else 0


@pytest.mark.slow
def test_a_recording_and_another_configuration(tmp_path: Path, start: type[Running]) -> None:
    """Taps are heard in what the service records beside its work: every one of them, and the bar's resonance; a
    recording ends on request, few are kept; a good configuration is taken, a bad one is refused with its reason."""
    taps = Taps(every_s=1.0)
    with Emulator(ServoLine.of("AX-12A", [1, 2], taps), CsvStream(taps)) as emulator:
        config = hardware(tmp_path, *emulator.paths)
        database = tmp_path / "history.db"
        service = start(config)
        service.wait_for("tip: reading")
        service.wait_for(f"{emulator.paths[0]}: reading")
        recording_path(database, 0).parent.mkdir()
        for earlier in range(KEPT + 2):
            recording_path(database, 100 + earlier).write_text("time,accel\n")
        number, answer = asked(database, Task.RECORD, "elbow", 60.0)
        path = recording_path(database, number)
        assert (answer.done, answer.text) == (True, f"joint elbow is recorded to {path}")
        wait_until(lambda: rows(path) > 4500)
        assert asked(database, Task.RECORD, "elbow")[1].text == "the recording has ended"
        service.wait_for("rows of joint elbow")
        recording = read_recording(path)
        assert recording.metadata["joint"] == "elbow"
        found = pooled([find_taps(*recording.signal("accel"))])
        assert 2 <= found.taps <= 6  # a busy machine loses samples, and the tap that they belong to
        assert found.f_res_hz.value == pytest.approx(58.0, abs=0.05)  # a 95 % interval misses it once in twenty runs
        assert recording.signal("command")[0].size > 50
        assert asked(database, Task.RECORD, "nobody", 1.0)[1].text.startswith("no joint is called 'nobody'")
        assert asked(database, Task.RELOAD)[1] == Answer(number + 3, True, "the service has taken the configuration")
        config.write_text(config.read_text().replace("f_res_hz = 58.0", "f_res_hz = -1"))
        answer = asked(database, Task.RELOAD)[1]
        assert not answer.done
        assert "the old configuration stays" in answer.text
        assert "f_res_hz" in answer.text
        assert service.log.read_text().count("configuration taken") == 1
        late = datetime.now(UTC) - timedelta(hours=1)
        old = wait(database, ask(database, Request(0, "elbow", Task.RECORD, for_s=5.0), late), 60.0)
        assert old is not None
        assert not old.done
        assert service.stop(signal.SIGTERM) == 0
    assert len(list(path.parent.iterdir())) == KEPT
