"""``lostmotion trend``: the wear of a joint from its history, as text, as JSON and as a plot.

The numbers are detector/trend.py's; the plots are trend_terminal.py's and trend_picture.py's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lostmotion.daemon import times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.reasons import others
from lostmotion.daemon.commands.where import find_config, open_joint
from lostmotion.daemon.records import from_micros, iso
from lostmotion.daemon.rollup import Series
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.forecast import TimeToLimit
from lostmotion.detector.normalise import normalised
from lostmotion.detector.trend import MOST, Slope, WearTrend, summarise
from lostmotion.detector.window import FloatArray
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.units import ARC_MINUTES

__all__ = [
    "COLUMNS",
    "RADIANS",
    "History",
    "Of",
    "TrendError",
    "document",
    "history_of",
    "table_row",
    "trend",
    "words",
]

Of = Literal["score", "play", "severity"]
MANY = {"score": "scores", "play": "plays", "severity": "severities"}
DAY = 86400.0
RADIANS = 1.0
UNITS = (("year", 365.25 * DAY), ("month", 30.4375 * DAY), ("day", DAY), ("hour", 3600.0), ("minute", 60.0))
MONTH = UNITS[1][1]
COLUMNS = ("of", "count", "now", "level", "slope", "direction", "limit")
PICTURES = (".png", ".svg", ".pdf")


class TrendError(LostmotionError):
    """There is too little history for a trend, or no such kind of picture."""

    status = 404
    """of the page: there is no trend"""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The severities of a joint, its scores that are numbers, or the sizes of its play, and their trend: what a plot
    shows.

    of, what: the quantity, and with its unit in words; start: UTC of time 0; time [s] and value, shape (N,), at the
    median excitation and temperature; laws: what of these it was freed of (``normalised``); impact, shape (N,); wear:
    with times from ``start``.
    """

    joint: str
    of: Of
    what: str
    start: datetime
    time: FloatArray
    value: FloatArray
    laws: dict[str, float]
    impact: np.ndarray[Any, np.dtype[np.bool_]]
    wear: WearTrend

    @property
    def many(self) -> str:
        """The quantity's name in the plural."""
        return MANY[self.of]

    @property
    def mark(self) -> str:
        """What stands behind a value: that of arc-minutes, nothing behind a score."""
        return "" if self.of == "score" else "'"

    @property
    def span(self) -> float:
        """From the first score to the last [s]."""
        return self.wear.last - self.wear.first

    def utc(self, time: float) -> datetime:
        """The UTC of a time [s]."""
        return self.start + timedelta(seconds=time)

    def medians(self, pieces: int) -> tuple[FloatArray, FloatArray]:
        """Median times [s] and values in equal pieces of time, shape (M,) each, empty pieces left out."""
        edges = np.linspace(self.wear.first, self.wear.last, pieces + 1)[1:-1]
        runs = np.split(np.arange(self.time.size), np.searchsorted(self.time, edges))
        full = [run for run in runs if run.size]
        return (
            np.array([np.median(self.time[run]) for run in full]),
            np.array([np.median(self.value[run]) for run in full]),
        )


def trend(
    joint: str,
    config: Path | None,
    database: Path | None,
    bounds: tuple[datetime | None, datetime | None],
    asked: Of | None,
    level: float | None,
    png: Path | None,
    as_json: bool,
) -> None:
    """Prints the trend of severities, scores or plays with since <= time < until against ``level``; draws ``png`` when
    given.  asked: which of them; None: severities where at least half of the rows have one, else scores."""
    times.check_order(*bounds)
    if png and png.suffix.lower() not in PICTURES:
        raise TrendError(f"--png: found the name {str(png)!r}, expected one that ends with {', '.join(PICTURES)}")
    with open_joint(joint, config, database) as reader:
        series, whose = reader.series(joint, *bounds, most=MOST), others(joint, reader.origins())
    history = history_of(joint, series, config, asked, level)
    of = history.of
    if png:
        from lostmotion.daemon.commands.trend_picture import draw

        draw(history, png)
    if as_json:
        output.print_json(document(history_of(joint, series, config, asked, level, RADIANS)))
        return
    from lostmotion.daemon.commands.trend_terminal import plot

    notes = (
        [] if asked or of == "severity" else ["too few of these scores have a severity: the trend is that of scores"]
    )
    is_ours = config is not None or database is None  # else the robot of the database is unknown
    radius_m = _radius(config, joint) if is_ours else math.nan
    lines = [f"{name:15}{text}" for name, text in words(history, radius_m, whose)]
    output.print_lines([*notes, _heading(history), *lines, ""])
    output.print_plot(plot(history))
    output.print_lines([f"picture: {png}"] if png else [])


def history_of(
    joint: str, series: Series, config: Path | None, asked: Of | None, level: float | None, unit: float = ARC_MINUTES
) -> History:
    """The values that are asked for, or those there is enough of, and their trend against ``level``, or against the
    limit that the configuration has.  unit: of a play and a severity, in a rad.  Raises TrendError."""
    of = asked or _best(series)
    if of != "score":
        level = level or _limit(config, of)
        if level > math.pi / 2:
            raise TrendError(f"found a limit of {level:g} rad, expected an angle as 0.01 rad, 30' or 0.5deg")
    return _history(joint, series, of, level, unit)


def _best(series: Series) -> Of:
    """What there is enough of: rows of earlier versions have no severity."""
    return "severity" if np.mean(np.isfinite(series["severity"]) if series.size else [0.0]) >= 0.5 else "score"


def _radius(config: Path | None, joint: str) -> float:
    """The radius of the joint's gear [m], NaN where it is not given."""
    return next((j.gear_radius_m for j in find_config(config).joints if j.name == joint), None) or math.nan


def _limit(config: Path | None, of: Of) -> float:
    """The severity, or the size of the play, that is an alarm [rad]."""
    alarm = find_config(config).alarm
    if of == "severity":
        return alarm.severity_error
    limit = alarm.play_error or alarm.play_warning
    if limit is None:
        raise TrendError("found no limit of the play; give --level [rad], or set alarm.play_error in the configuration")
    return limit


def _history(joint: str, series: Series, of: Of, level: float | None, unit: float) -> History:
    series = series[np.isfinite(series[of])]
    if not series.size:
        raise TrendError(f"found no {MANY[of]} of {joint!r} in that time, expected at least 3; try an earlier --since")
    scale = 1.0 if of == "score" else unit
    limit = scale * (level or float(series["level"][-1]))
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = {"excitation": np.log(series["excitation"]), "temperature": series["temperature"]}
    time = (series["time_us"] - series["time_us"][0]) / 1e6
    value, laws = normalised(scale * series[of], moved)
    try:
        wear = summarise(time, value, limit)
    except DetectorError as error:
        raise TrendError(f"joint {joint!r}: {error}; let it run for longer, or try an earlier --since") from error
    what = "score [-]" if of == "score" else f"{of} [arc-minutes]"
    return History(joint, of, what, from_micros(int(series["time_us"][0])), time, value, laws, series["impact"], wear)


def document(history: History) -> dict[str, Any]:
    """The trend as JSON."""
    wear = history.wear
    return {
        "joint": history.joint,
        "of": history.of,
        "count": wear.count,
        "first": iso(history.utc(wear.first)),
        "last": iso(history.utc(wear.last)),
        "level": wear.limit,
        "current": wear.current,
        "slope": _per_month(wear.slope),
        "mann_kendall": {
            "p_value": wear.trend.p_value,
            "tau": wear.trend.tau,
            "direction": wear.trend.direction,
        },
        "change_points": [iso(history.utc(time)) for time in wear.change_points],
        "recent_slope": _per_month(wear.recent),
        "time_to_limit": _wait(wear.time_to_limit),
        "forecast": _wait(wear.forecast),
        "no_forecast": wear.no_forecast or None,
        "normalised": history.laws,
    }


def _wait(left: TimeToLimit | None) -> dict[str, float] | None:
    return {"likely_s": left.likely, "earliest_s": left.earliest, "latest_s": left.latest} if left else None


def _per_month(slope: Slope) -> dict[str, float]:
    return {"per_month": slope.slope * MONTH, "low": slope.low * MONTH, "high": slope.high * MONTH}


def words(history: History, radius_m: float, whose: str) -> list[tuple[str, str]]:
    """The trend as people read it, in the terminal and on the page: a name and a text for each of its lines.

    radius_m: that of the joint's gear, NaN where it is unknown; the history is in arc-minutes.  whose: ``others`` of
    the joint.
    """
    wear = history.wear
    found = f"{wear.trend.direction} (p = {wear.trend.p_value:.2g})" if wear.trend.direction != "none" else "none found"
    lines = [
        *([("impacts", f"{whose}: this trend is not the wear of {history.joint}")] if whose else []),
        *_laws(history.laws),
        ("trend", f"{found}, Mann-Kendall tau {wear.trend.tau:+.2f}"),
        ("slope", _slope(wear.slope, history)),
    ]
    if wear.change_points:
        when = ", ".join(f"{history.utc(time):%Y-%m-%d %H:%M}" for time in wear.change_points)
        lines += [("changed", f"{when} UTC"), ("since then", _slope(wear.recent, history))]
    return [
        *lines,
        ("now", f"{wear.current:.2f}{history.mark}, level {wear.limit:.2f}{history.mark}"),
        ("limit", _left(wear)),
        *_forecast_lines(wear),
        *_sizes(history, radius_m),
    ]


def _heading(history: History) -> str:
    first, last = (f"{history.utc(time):%Y-%m-%d %H:%M}" for time in (history.wear.first, history.wear.last))
    return f"{history.joint}: {history.wear.count} {history.many}, {first} to {last} UTC"


def _laws(laws: dict[str, float]) -> list[tuple[str, str]]:
    """What the values were freed of."""
    texts = {"excitation": "excitation^{:+.2f}", "temperature": "{:+.2%} a °C"}
    found = [texts[name].format(slope) for name, slope in laws.items()]
    return [("freed of", f"{', '.join(found)}: values at the median motion and temperature")] if found else []


def _sizes(history: History, radius_m: float) -> list[tuple[str, str]]:
    """How large the play was at first and is now: medians of the first and last tenth [arc-minutes]."""
    if history.of == "score":
        return []
    tenth = max(history.value.size // 10, 1)
    ends = [float(np.median(part)) / ARC_MINUTES for part in (history.value[:tenth], history.value[-tenth:])]
    sizes = [f"{output.arcmin(end)}" for end in ends]
    if math.isfinite(radius_m):
        sizes = [f"{size} ({end * radius_m * 1e6:.3g} µm)" for size, end in zip(sizes, ends, strict=True)]
        sizes[1] += f" on a gear of {radius_m * 1e3:g} mm"
    return [("wear", f"from {sizes[0]} to {sizes[1]}")]


def table_row(history: History) -> list[str]:
    """The trend in the cells of ``COLUMNS``."""
    wear = history.wear
    numbers = [str(wear.count), f"{wear.current:.2f}", f"{wear.limit:.2f}"]
    return [history.what, *numbers, _slope(wear.slope, history), wear.trend.direction, _left(wear)]


def _slope(slope: Slope, history: History) -> str:
    """The slope in the unit that suits the length of the history."""
    name, length = next((unit for unit in UNITS if history.span >= unit[1] / 2), UNITS[-1])
    per, low, high = (f"{rate * length:+.3g}{history.mark}" for rate in (slope.slope, slope.low, slope.high))
    return f"{per} per {name} (95 %: {low} to {high})"


def _forecast_lines(wear: WearTrend) -> list[tuple[str, str]]:
    """The forecast, where the limit still lies ahead."""
    forecast = wear.forecast
    if forecast is None or forecast.likely == 0 or not math.isfinite(forecast.earliest):
        return []
    return [("forecast", f"{_reached(forecast, '80 %', 'not reached')}, whatever the law of wear")]


def _left(wear: WearTrend) -> str:
    """When the limit is reached by the slope since the last change, or by that of the whole history without one."""
    left, never = wear.time_to_limit, f"not reached at {'the slope since then' if wear.change_points else 'this slope'}"
    if wear.no_forecast:
        return f"no forecast: {wear.no_forecast}"
    if left is None:
        return never
    if left.likely == 0:
        return "reached"
    return _reached(left, "95 %", never)


def _reached(left: TimeToLimit, sure: str, never: str) -> str:
    """When the limit is reached, with the interval of this probability; ``never`` where that is unlikely."""
    likely, earliest, latest = _spans(left)
    if likely == "never":
        return f"{never} ({sure}: not before {earliest} from now)"
    return f"reached in {likely} ({sure}: {earliest} to {latest})"


def _spans(left: TimeToLimit) -> list[str]:
    """Its three spans in words."""
    return [times.span(t) if math.isfinite(t) else "never" for t in (left.likely, left.earliest, left.latest)]
