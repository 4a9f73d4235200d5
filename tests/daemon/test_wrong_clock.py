"""A system clock that is wrong, for a moment or from the start, thins no history and leaves no stamp far off: the
arithmetic alone, and the service in a process whose clock a file sets."""

from __future__ import annotations

import signal
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow, micros
from lostmotion.daemon.store import Store
from lostmotion.daemon.timekeeper import AHEAD_S, CONFIRMED_S, ODD_CONFIRMED_S, ClockRow, Mend, Timekeeper
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.test_service import count

Start = Callable[..., Running]
YEAR_S = 365.25 * 86400
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC).timestamp()
MANY = 5000


def never() -> bool:
    """No network time."""
    return False


def always() -> bool:
    """Network time has set the clock."""
    return True


def stamp(keeper: Timekeeper, now: float) -> float:
    """A stamp as seconds since 1970."""
    return keeper.utc(now).timestamp()


def test_fourteen_seconds_at_2090() -> None:
    """Stamps go on as before, the step is told, and nothing is left of it afterwards; small steps are followed."""
    keeper = Timekeeper(100.0, NOW, never)
    for second in range(14):
        assert keeper.look(101.0 + second, NOW + 1 + second + 64 * YEAR_S, never) is None
        assert stamp(keeper, 101.0 + second) == pytest.approx(NOW + 1 + second, abs=1e-3)
        assert keeper.step == pytest.approx(64 * YEAR_S)
    assert keeper.look(115.0, NOW + 15.5, never) is None
    assert (stamp(keeper, 115.0), keeper.step) == (pytest.approx(NOW + 15.5, abs=1e-3), 0.0)


@pytest.mark.parametrize(("years", "after_s"), [(0.5, CONFIRMED_S), (64.0, ODD_CONFIRMED_S), (-1.0, ODD_CONFIRMED_S)])
def test_a_step_that_lasts_is_followed(years: float, after_s: float) -> None:
    """Without network time after an hour, a step to a time that cannot be after a day; it mends nothing."""
    keeper = Timekeeper(0.0, NOW, never)
    step = years * YEAR_S
    for now in (1.0, after_s):
        assert keeper.look(now, NOW + now + step, never) is None
        assert stamp(keeper, now) == pytest.approx(NOW + now, abs=1e-3)
    assert keeper.look(after_s + 1.0, NOW + after_s + 1 + step, never) is None
    assert stamp(keeper, after_s) == pytest.approx(NOW + after_s + step, abs=1e-3)


def test_network_time_mends_what_came_before_it() -> None:
    """A computer without a battery starts half a year late; network time moves its stamps.  A step after that one is
    followed at once and moves nothing."""
    keeper = Timekeeper(0.0, NOW, never, known=NOW - 60, bound=NOW - 60)
    assert not keeper.is_doubtful
    late = 0.5 * YEAR_S
    mend = keeper.look(30.0, NOW + 30 + late, always)
    assert mend is not None
    assert mend.shift.total_seconds() == pytest.approx(late)
    assert mend.since.timestamp() <= NOW
    assert mend.until.timestamp() == pytest.approx(NOW + 30, abs=1e-3)
    assert keeper.look(60.0, NOW + 60 + late + 3600, always) is None
    assert stamp(keeper, 60.0) == pytest.approx(NOW + 60 + late + 3600, abs=1e-3)


@pytest.mark.parametrize("utc", [NOW + 64 * YEAR_S, 0.0])
def test_a_start_at_an_impossible_time(utc: float) -> None:
    """Stamps go on from the last known time and are in doubt, until the clock shows a possible time: then they are
    moved to it.  Network time is believed at once."""
    keeper = Timekeeper(0.0, utc, never, known=NOW, bound=NOW)
    assert keeper.is_doubtful
    assert stamp(keeper, 5.0) == pytest.approx(NOW + 5)
    mend = keeper.look(10.0, NOW + 5000, never)
    assert mend is not None
    assert mend.shift.total_seconds() == pytest.approx(4990)
    assert not keeper.is_doubtful
    assert not Timekeeper(0.0, utc, always, known=NOW, bound=NOW).is_doubtful


def test_what_is_old_is_bounded_by_uptime() -> None:
    """Whatever the clock shows, the time up to which scores may be called old moves on by two seconds a second at most,
    and never beyond the stamps."""
    keeper = Timekeeper(0.0, NOW + 0.9 * AHEAD_S, always, known=NOW, bound=NOW)
    assert keeper.row.bound_us == round(NOW * 1e6)
    keeper.look(1000.0, NOW + 0.9 * AHEAD_S + 1000, always)
    assert keeper.row.bound_us == round((NOW + 2000) * 1e6)
    same = Timekeeper(0.0, NOW, never, known=NOW - 5, bound=NOW - 5)
    same.look(1000.0, NOW + 1000, never)
    assert same.row.bound_us == same.row.known_us == round((NOW + 1000) * 1e6)


def test_rows_are_mended_in_the_database(tmp_path: Path) -> None:
    """Scores of the wrong stretch are moved and lose their mark, the other words of their quality stay; others are left
    alone; and old scores are thinned only up to the bound."""
    path, at = tmp_path / "history.db", datetime.fromtimestamp(NOW, UTC)

    def score(seconds: float, quality: str) -> ScoreRow:
        return ScoreRow("elbow", at + timedelta(seconds=seconds), 0.25, 1.0, 8.0, False, quality=quality)

    store = Store(path, "arm1", keep_scores_days=1.0)
    store.add(score(-100, "gappy"), *(score(k, ("clock", "gappy,clock", "ok")[k]) for k in range(3)))
    store.add(ClockRow(micros(at), micros(at)), score(64 * YEAR_S, "ok"))
    store.add(Mend(at - timedelta(seconds=60), at + timedelta(seconds=60), timedelta(hours=5)))
    store.close()
    with open_readonly(path) as reader:
        moved = [score(18000, "ok"), score(18001, "gappy"), score(18002, "ok")]
        assert reader.scores("elbow") == [score(-100, "gappy"), *moved, score(64 * YEAR_S, "ok")]
        assert reader.clock() == ClockRow(micros(at), micros(at))


# --- the service ------------------------------------------------------------------------------------------------------


def worn(path: Path) -> None:
    """Five thousand scores of the last four days, by an earlier run."""
    now = datetime.now(UTC)
    with closing(Store(path, "fake")) as store:
        store.add(
            *(ScoreRow("elbow", now - timedelta(seconds=70.0 * (k + 1)), 0.25, 1.0, 8.0, False) for k in range(MANY))
        )


def stamps(path: Path) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Those of the fake elbow, newest run only [s since 1970]."""
    with open_readonly(path) as reader:
        return np.array([row.time.timestamp() for row in reader.scores("elbow")][MANY:])


@pytest.mark.slow
def test_a_service_whose_clock_jumps_to_2090(tmp_path: Path, start: Start) -> None:
    """Three seconds there and back: no score of the past is lost, no stamp of 2090 is found, and the log tells it."""
    path, database, ahead = tmp_path / "fake.toml", tmp_path / "history.db", tmp_path / "ahead"
    worn(database)
    ahead.write_text("0")
    path.write_text(fake_config(tmp_path))
    service = start(path, FAKE_CLOCK=str(ahead))
    wait_until(lambda: count(database) >= MANY + 4)
    ahead.write_text(f"{64 * YEAR_S}")
    service.wait_for("the system's clock has stepped by +2019686400 s: stamps go on as before until it is confirmed")
    time.sleep(3.0)
    ahead.write_text("0")
    service.wait_for("the system's clock is followed again")
    before = count(database)
    wait_until(lambda: count(database) >= before + 4)
    time.sleep(1.0)
    assert service.stop(signal.SIGTERM) == 0
    found = stamps(database)
    assert count(database) == MANY + len(found) > MANY + 15
    assert np.diff(found) == pytest.approx(np.full(len(found) - 1, 0.25), abs=0.02)
    assert abs(found[-1] - time.time()) < 30


@pytest.mark.slow
def test_a_service_that_starts_in_2090(tmp_path: Path, start: Start) -> None:
    """Its scores are marked and go on from the last known time; when the clock is right they are moved there without
    their mark, and nothing of the past is lost."""
    path, database, ahead = tmp_path / "fake.toml", tmp_path / "history.db", tmp_path / "ahead"
    worn(database)
    ahead.write_text("0")
    path.write_text(fake_config(tmp_path))
    service = start(path, FAKE_CLOCK=str(ahead))
    wait_until(lambda: count(database) >= MANY + 1)
    assert service.stop(signal.SIGTERM) == 0
    first = count(database)
    ahead.write_text(f"{64 * YEAR_S}")
    service = start(path, FAKE_CLOCK=str(ahead))
    service.wait_for("the system's clock is far from the last known time")
    wait_until(lambda: count(database) >= first + 8)
    with closing(sqlite3.connect(database)) as db:
        assert db.execute("SELECT count(*) FROM scores WHERE quality = 'clock' AND time < '2089'").fetchone()[0] >= 8
    ahead.write_text("0")
    service.wait_for("the system's clock is right now")
    before = count(database)
    wait_until(lambda: count(database) >= before + 4)
    assert service.stop(signal.SIGTERM) == 0
    found = stamps(database)[first - MANY :]
    assert count(database) == first + len(found)
    assert np.diff(found) == pytest.approx(np.full(len(found) - 1, 0.25), abs=0.02)
    assert abs(found[-1] - time.time()) < 30
    with open_readonly(database) as reader:
        assert {row.quality for row in reader.scores("elbow")} == {"ok"}
