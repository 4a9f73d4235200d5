"""LeRobot's datasets, versions 2 and 3: one episode's states and actions, by the names of the robot's joints.

The format has no units: robots are recorded in degrees or in -100 to 100 of each joint's range, simulated ones in
rad.  The unit is assumed from the size of the numbers, and reported.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.parquet import as_numbers, readable
from lostmotion.drivers.formats.source import MOST_SERIES, Choice, Samples, Series, check_count, reason, shown, too_many
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.textfile import TextFileError, read_text
from lostmotion.drivers.units import MANY_TURNS

__all__ = ["INFO", "Dataset", "open_lerobot"]

INFO = Path("meta", "info.json")
BOOKKEEPING = ("timestamp", "frame_index", "episode_index", "index", "task_index", "next.done")
ANGULAR = ("observation.state", "action")
RANGE = 100.5
"""numbers beyond are not normalised"""
ROUNDED_S = 1e-3
"""times are written as float32"""


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a series stands: a column of the tables, and the place in its lists, None for plain numbers."""

    column: str
    place: int | None


class Dataset:
    """A ``Source``."""

    def __init__(self, path: Path) -> None:
        self._path = path
        info = _info(path)
        self._places = _places(info, path)
        self._files = sorted((path / "data").rglob("*.parquet"))
        self._fps = float(info.get("fps") or 0)
        self._episodes = int(info.get("total_episodes") or 0)
        self.kind = f"LeRobot dataset {shown(str(info.get('codebase_version', 'of unknown version')))}"
        if not self._files:
            raise RecordingError(f"{path}: found no data/**/*.parquet, expected episodes; was a part downloaded?")
        largest = self._largest()
        self.series = [Series(name, _unit(place, largest.get(name))) for name, place in self._places.items()]
        self.notes = _notes({name: each for name, each in largest.items() if name.startswith(ANGULAR)})

    def read(self, names: Sequence[str], choice: Choice) -> Samples:
        """The samples of an episode.  Raises RecordingError."""
        episode = self._episode(choice.episode)

        def load(wanted: Sequence[str]) -> Mapping[str, NDArray[Any]]:
            return self._load(wanted, episode)

        series = [*self.series, Series("timestamp", "s")]
        return Table(str(self._path), self.kind, series, load).read(names, choice)

    def _episode(self, asked: int | None) -> int:
        if asked is None and self._episodes != 1:
            raise RecordingError(
                f"{self._path}: found {self._episodes} episodes, expected one; choose with --episode N (or "
                f"FOLDER#episode=N) from 0 to {max(self._episodes - 1, 0)}"
            )
        return asked or 0

    def _load(self, names: Sequence[str], episode: int) -> dict[str, NDArray[Any]]:
        columns = {name: self._places.get(name, _Place(name, None)) for name in names}
        table = self._table(sorted({each.column for each in columns.values()}), [("episode_index", "==", episode)])
        if table.num_rows == 0:
            raise RecordingError(
                f"{self._path}: found no rows of episode {episode}, expected one of 0 to {max(self._episodes - 1, 0)}"
            )
        check_count(str(self._path), table.num_rows * len(names))
        with readable(self._path):
            found = {name: _numbers(table, each) for name, each in columns.items()}
        if "timestamp" in found:
            found["timestamp"] = self._exact(found["timestamp"])
        return found

    def _exact(self, times: NDArray[Any]) -> NDArray[Any]:
        """Times that float32 has rounded, as the whole numbers of frames that they are."""
        if not self._fps > 0:
            return times
        frames = np.round(times * self._fps) / self._fps
        return frames if np.abs(frames - times).max() < ROUNDED_S else times

    def _largest(self) -> dict[str, float]:
        """The largest magnitude of each series in the first file."""
        wanted = {name: place for name, place in self._places.items() if place.column in ANGULAR}
        table = self._table(sorted({place.column for place in wanted.values()}), None, self._files[:1])
        with readable(self._path):
            return {name: float(np.nanmax(np.abs(_numbers(table, place)), initial=0)) for name, place in wanted.items()}

    def _table(self, columns: Sequence[str], filters: Any, files: Sequence[Path] | None = None) -> Any:
        parquet = needed("pyarrow.parquet", self._path)
        with readable(self._path):
            return parquet.read_table(list(files or self._files), columns=columns, filters=filters)


def open_lerobot(path: Path) -> Dataset:
    """Raises RecordingError."""
    return Dataset(path)


def _info(path: Path) -> dict[str, Any]:
    try:
        info = json.loads(read_text(path / INFO))
        float(info.get("fps") or 0), int(info.get("total_episodes") or 0), info["features"].items()
    except TextFileError as error:
        raise RecordingError(str(error)) from error
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise RecordingError(
            f"{path / INFO}: found no description of a dataset ({reason(error)}), expected features, fps, "
            "total_episodes"
        ) from error
    return dict(info)


def _places(info: Mapping[str, Any], path: Path) -> dict[str, _Place]:
    """The series of all features that are numbers or short lists of them."""
    found: dict[str, _Place] = {}
    for feature, spec in info["features"].items():
        shape = spec.get("shape") if isinstance(spec, Mapping) else None
        kind = str(spec.get("dtype", "")) if isinstance(spec, Mapping) else ""
        count = _length(shape)
        if feature in BOOKKEEPING or not kind.startswith(("float", "int")) or not count:
            continue
        if count == 1:
            found[feature] = _Place(feature, None)
            continue
        for place, name in enumerate(_names(spec.get("names"), count)):
            found[f"{feature}[{name}]"] = _Place(feature, place)
        if len(found) > MOST_SERIES:
            raise too_many(str(path), len(found), "series")
    if not found:
        raise RecordingError(f"{path / INFO}: found no features of numbers, expected observation.state or action")
    return found


def _length(shape: Any) -> int:
    """Of a feature that is a vector, 0 for any other."""
    is_vector = isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int)
    return int(shape[0]) if is_vector and 0 < shape[0] <= MOST_SERIES else 0


def _names(names: Any, count: int) -> list[str]:
    """Of the joints, as a list, a list in a list (datasets of humanoids) or {"motors": list}; else their numbers."""
    lists = [*names.values()] if isinstance(names, Mapping) else [names]
    for each in lists:
        if isinstance(each, list) and len(each) == 1 and isinstance(each[0], list):
            each = each[0]
        if isinstance(each, list) and len(each) == count and len(set(map(str, each))) == count:
            return [str(name) for name in each]
    return [str(place) for place in range(count)]


def _numbers(table: Any, place: _Place) -> NDArray[Any]:
    return as_numbers(table, place.column if place.place is None else f"{place.column}[{place.place}]")


def _unit(place: _Place, largest: float | None) -> str:
    return "" if place.column not in ANGULAR or largest is None else "deg" if largest > MANY_TURNS else "rad"


def _notes(largest: Mapping[str, float]) -> list[str]:
    """Which unit was assumed, and why."""
    most = max(largest.values(), default=0.0)
    if most > RANGE:
        return [f"LeRobot has no unit: numbers up to {most:.4g} are taken as degrees"]
    if most > MANY_TURNS:
        assumed = (
            f"LeRobot has no unit: numbers up to {most:.4g} are taken as degrees; recorded without use_degrees they "
            "are -100 to 100 of a joint's range: then use position=SERIES*FACTOR, a hundredth of half the range [rad]"
        )
        return [assumed]
    return [f"LeRobot has no unit: numbers up to {most:.4g} are taken as rad"] if largest else []
