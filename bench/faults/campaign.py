"""One campaign: some faults at random, one after another and now and then two at once, and what must hold."""

from __future__ import annotations

import random
import re
import sqlite3
import tempfile
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from tests.daemon.alarm_world import broken_links, stored

from bench.faults.attacks import ATTACKS, LOSS, Attack
from bench.faults.world import NODE, Witness, World
from bench.process import memory_mb
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmRow
from lostmotion.daemon.sinks.emcy import _code

__all__ = ["Outcome", "run"]

FAULTS = 4
READY_S, TOLD_S, HIDDEN_S, LASTS_S, CALM_S, HEARD_S = 60.0, 30.0, 10.0, (1.5, 5.0), 60.0, 30.0
"""until the first scores; until a fault is told; until one on top of another is; how long one lasts that need
not be told; until all works again; until a subscriber has heard all alarms [s]"""
SAID_BEFORE, SAID_AFTER = 300, 3000
"""so many characters of the log are shown around a traceback: what fails with one seed seldom fails with it again"""
MOST_MB, MOST_FILES, MOST_THREADS, MOST_LINES = 70.0, 64, 24, 200
"""own memory [MB]: of nine campaigns 35 to 47"""


@dataclass
class Outcome:
    """What came of a seed: its faults, how long each took to be told [s] (None: nothing to tell), and what failed."""

    seed: int
    told: list[tuple[str, float | None]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    scores: int = 0


def run(seed: int) -> Outcome:
    """Runs one campaign; one that breaks has failed, with what the service said last."""
    outcome, dice = Outcome(seed), random.Random(seed)
    with tempfile.TemporaryDirectory() as folder, World(Path(folder), dice) as world:
        try:
            _campaign(world, outcome)
        except Exception as error:  # noqa: BLE001 - the other campaigns go on
            outcome.failures.append(f"it broke: {error!r}; the log ends: {world.said[-SAID_AFTER:]}")
    return outcome


def _campaign(world: World, outcome: Outcome) -> None:
    begun = time.time()
    if not _wait(lambda: count(world.database) >= 5, READY_S):
        outcome.failures.append(f"no scores at the start: {world.said[-400:]}")
        return
    witness = Witness(world.database, world.left, world.is_mixed)
    try:
        _attack(world, outcome)
        _calm(world, outcome)
    finally:
        witness.close()
    outcome.failures += [*sorted(witness.wrong), *world.wrong]
    _check_process(world, outcome)
    _check_subscriber(world, outcome)
    if (status := world.stop()) != 0:
        outcome.failures.append(f"exit status {status}")
    time.sleep(0.2)
    _check_database(world, outcome, begun)
    _check_log(world, outcome)


def _attack(world: World, outcome: Outcome) -> None:
    waiting: list[Callable[[], None]] = []
    for attack in world.dice.sample(ATTACKS, FAULTS):
        length = len(world.said)
        began = time.monotonic()
        end = attack.begin(world)
        outcome.told.append((attack.name, _told(world, attack, length, began, outcome, waiting)))
        time.sleep(world.dice.uniform(*LASTS_S) if not attack.told else 0.5)
        if world.dice.random() < 0.3 and attack.name != "service killed" and not waiting:
            waiting.append(end)  # the next one comes on top
            continue
        for done in (*waiting, end):
            done()
        waiting.clear()
        _wait(lambda: world.process is not None and world.process.poll() is None, 5.0)
        _wait(lambda: count(world.database) > 0, READY_S)
        time.sleep(world.dice.uniform(0.5, 2.0))
    for done in waiting:
        done()


def _told(
    world: World, attack: Attack, length: int, began: float, outcome: Outcome, waiting: list[Callable[[], None]]
) -> float | None:
    """How long it took [s]; a fault that another one hides has to be told when that one is over."""
    if not attack.told:
        return None
    if attack.told is LOSS:  # an alarm of losses that stands, as of a service that was stopped, tells these too
        length = min(length, max(world.said.rfind("event=cleared"), 0))
    if waiting and not _wait(lambda: re.search(attack.told, world.said[length:]), HIDDEN_S):
        for done in waiting:
            done()
        waiting.clear()
        began = time.monotonic()
    if not _wait(lambda: re.search(attack.told, world.said[length:]), TOLD_S):
        outcome.failures.append(f"{attack.name}: not told within {TOLD_S:g} s; the log: {world.said[length:][-300:]}")
    return time.monotonic() - began


def _calm(world: World, outcome: Outcome) -> None:
    """All faults are over: scores come again."""
    before = count(world.database)
    if not _wait(lambda: count(world.database) >= before + 8, CALM_S):
        outcome.failures.append(f"no scores after the faults; the log ends: {world.said[-500:]}")
    if world.process is not None and world.process.poll() is not None:
        outcome.failures.append(f"the service has ended with {world.process.returncode}")
    time.sleep(2.0)


def _check_process(world: World, outcome: Outcome) -> None:
    with suppress(OSError, AssertionError):
        proc = Path(f"/proc/{world.pid}")
        found = (
            ("MB", memory_mb(world.pid, "RssAnon"), MOST_MB),
            ("files", len([*(proc / "fd").iterdir()]), MOST_FILES),
            ("threads", len([*(proc / "task").iterdir()]), MOST_THREADS),
        )
        outcome.failures += [
            f"{value:.0f} {what}, expected {most} at most" for what, value, most in found if value > most
        ]


def _check_subscriber(world: World, outcome: Outcome) -> None:
    """All transitions that are stored are heard in the end, each once."""
    missing = {"?"}

    def all_heard() -> bool:
        nonlocal missing
        missing = {transition.id for transition in stored(world.database)} - set(world.watcher.ids)
        return not missing

    if not _wait(all_heard, HEARD_S):
        outcome.failures.append(f"stored and not heard over Zenoh: {sorted(missing)[:3]}")
    heard = world.watcher.ids
    if len(set(heard)) < len(heard):
        outcome.failures.append(f"heard {len(heard)} transitions over Zenoh, {len(set(heard))} different ones")


def _check_database(world: World, outcome: Outcome, begun: float) -> None:
    with closing(sqlite3.connect(world.database)) as db:
        if (sound := db.execute("PRAGMA integrity_check").fetchone()[0]) != "ok":
            outcome.failures.append(f"database: {sound}")
    with open_readonly(world.database) as reader:
        scores = [row for row in reader.scores("elbow") if row.score == row.score]
        off = [row.time for row in reader.scores("elbow") if not begun - 60 < row.time.timestamp() < time.time() + 5]
        transitions = [transition for _, transition in reader.transitions()]
        alarms = reader.alarms()
    outcome.scores = len(scores)
    pairs = pairwise(scores)  # the emulator repeats itself every 20 s, to the last bit
    if twice := [one for one, other in pairs if one.score == other.score]:
        outcome.failures.append(f"{len(twice)} scores are there twice, such as {twice[0]}")
    if off:
        outcome.failures.append(f"{len(off)} stamps far off, such as {off[0]}")
    begun_anew = any(name.startswith("database ") and name != "database locked" for name, _ in outcome.told)
    if not begun_anew and (broken := broken_links(transitions)):  # a new file begins in the midst of an alarm's life
        outcome.failures.append(f"transitions that do not follow: {broken[:3]}")
    if (heard := _kept(world)) != (stands := _standing(alarms)):
        outcome.failures.append(f"a CAN master holds {sorted(heard)}, the database {sorted(stands)}")


def _check_log(world: World, outcome: Outcome) -> None:
    for word in ("Traceback", "internal error"):
        if (at := world.said.find(word)) >= 0:
            outcome.failures.append(f"log: {world.said[max(at - SAID_BEFORE, 0) : at + SAID_AFTER]}")
    if (lines := world.said.count("\n")) > MOST_LINES:
        outcome.failures.append(f"{lines} lines in the log")
    if any(world.exits) and set(world.exits) != {2}:
        outcome.failures.append(f"the second service ended with {world.exits}")


def _kept(world: World) -> set[int]:
    """The error codes that a master holds which keeps all until a reset."""
    kept = set[int]()
    for code in world.adapter.emergencies(NODE):
        kept = kept | {code} if code else set()
    return kept


def _standing(alarms: list[AlarmRow]) -> set[int]:
    return {_code(alarm) for alarm in alarms} - {0}


def count(database: Path) -> int:
    """How many scores are committed."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=1.0)) as db:
        return int(db.execute("SELECT count(*) FROM scores").fetchone()[0])
    return 0


def _wait(condition: Callable[[], object], timeout_s: float) -> bool:
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True
