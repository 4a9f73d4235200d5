"""Other requests to a running service than about alarms: to record a joint, to reload the configuration.

The requests are in the database with those of ``requests.py``, and are polled as often.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from lostmotion.daemon.capture import Capture, also_moved_by, head
from lostmotion.daemon.config import ConfigError
from lostmotion.daemon.reader import Reader
from lostmotion.daemon.records import Answer, Request, Task
from lostmotion.daemon.robot import Robot

__all__ = ["LONGEST_S", "Tasks", "recording_path"]

LONGEST_S = 1800.0
"""of a recording [s]"""
KEPT = 3
"""recordings that stay, the newest"""
STALE = timedelta(seconds=20)
"""a request that was left for a service that did not run is not taken up later"""
FOLDER = "recordings"


def recording_path(database: Path, request: int) -> Path:
    """Where the service writes what a request asks for: beside the database."""
    return database.parent / FOLDER / f"{request:09d}.csv"


class Tasks:
    """Carries out requests while one configuration is in use; ``reload`` is the request for another one, 0 without any.

    seen: the requests that were taken up, number and time; whose answers may not be on the disk yet.
    """

    def __init__(
        self,
        robot: Robot,
        reader: Reader,
        database: Path,
        utc: Callable[[], datetime],
        seen: set[tuple[int, datetime]],
    ) -> None:
        self._robot, self._reader, self._database, self._utc, self._seen = robot, reader, database, utc, seen
        self.reload = 0

    def take(self) -> list[Answer]:
        """Carries out the requests since the last call; the answers so far."""
        answers = []
        for request in self._reader.tasks():
            if (request.id, request.made) in self._seen:
                continue
            self._seen.add((request.id, request.made))
            if datetime.now(UTC) - request.made > STALE:
                answers.append(Answer(request.id, False, "no service ran when this was asked; ask again"))
            elif request.verb is Task.RELOAD:
                self.reload = request.id
            else:
                answers.append(self._record(request))
        return answers

    def close(self) -> None:
        """Ends a recording; reads no more."""
        self._robot.capture(None)
        self._reader.close()

    def _record(self, request: Request) -> Answer:
        """Begins a recording, or ends the one that runs: ``for_s`` 0."""
        if request.for_s <= 0:
            self._robot.capture(None)
            return Answer(request.id, True, "the recording has ended")
        try:
            joint = self._robot.config.joint(request.joint)
        except ConfigError as error:
            return Answer(request.id, False, str(error))
        path = recording_path(self._database, request.id)
        try:
            _make_room(path)
        except OSError as error:
            return Answer(request.id, False, f"{path.parent}: cannot be written: {error.strerror}")
        config = self._robot.config
        sensor = config.accelerometer(joint.accelerometer)
        others = also_moved_by(config, joint)
        metadata = head(config, sensor, joint, self._utc(), self._robot.limits(joint), others)
        duration_s = min(request.for_s, LONGEST_S)
        self._robot.capture(Capture(path, joint.name, metadata, self._robot.clock, duration_s))
        return Answer(request.id, True, f"joint {joint.name} is recorded to {path}")


def _make_room(path: Path) -> None:
    """The folder is there, may be written, and holds few recordings."""
    path.parent.mkdir(exist_ok=True)
    for old in sorted(path.parent.glob("[0-9]*.csv"), key=lambda one: one.stat().st_mtime)[: 1 - KEPT]:
        with suppress(FileNotFoundError):
            old.unlink()
    path.touch()
