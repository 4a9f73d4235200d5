"""The results of the lab: fits, explanations, ladders.  Nothing is computed here.

``document()`` of each is what ``--json`` prints; other programs rely on its keys.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = [
    "Curve", "Displayed", "Errors", "Estimate", "Explanation", "Finding", "Fit",
    "Ladder", "Ranked", "Rung", "Verdict", "ladder_of",
]  # fmt: skip

Verdict = Literal["missing", "nothing_missing", "outside_catalogue"]


class Displayed:
    """A result that a notebook shows.  The report does that, a layer above this module, which is imported by its name
    when a result is first shown."""

    __slots__ = ()

    def __repr__(self) -> str:
        """The verdict in sentences, without the arrays."""
        sentences = " ".join(_report("verdict").of(self))
        return f"<{type(self).__name__}: {sentences}>"

    def _repr_html_(self) -> str:
        """The verdict in sentences, and a table."""
        return str(_report("notebook").html(self))

    def plot(self) -> Any:
        """Measured and modelled over time, and the residual, as a ``matplotlib.figure.Figure``."""
        return _report("notebook").plot(self)


def _report(module: str) -> Any:
    return import_module(f"lostmotion.lab.report.{module}")


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % confidence interval, SI units.

    identified: whether these recordings determine it; at_bound: whether the fit ended at one of its bounds.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    identified: bool = True
    at_bound: bool = False

    def held_document(self) -> dict[str, Any]:
        """One entry of ``scale``."""
        return {"parameter": self.name, "value": _number(self.value), "unit": self.unit}


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Displayed):
    """A model fitted to experiments.

    starts: the state (n,) with which each experiment begins, none where the torque of a joint was fitted and no motion
    is simulated; correlation: (P, P) of the estimates; noise, rms: by column, its unit; substep_s: the integration step
    that was used.
    """

    model: Model
    experiments: tuple[Experiment, ...]
    starts: tuple[FloatArray, ...]
    estimates: tuple[Estimate, ...]
    correlation: FloatArray
    noise: Mapping[str, float]
    rms: Mapping[str, float]
    substep_s: float
    complete: bool = False
    """Whether the residual of the first column, which was fitted, is noise."""
    stopped_early: bool = False
    """Whether the user ended the fit."""
    held: tuple[Estimate, ...] = ()
    """Parameters that these recordings cannot determine, with the values at which they were held."""
    band_hz: float = math.inf
    """The highest end of the band in which the torque of a joint was compared."""
    delay_s: float = 0.0
    """How much later than recorded that torque acts; the experiments are without this delay."""

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of that parameter.  Raises KeyError, which names those that were free, for another one."""
        found = {estimate.name: estimate for estimate in self.estimates}
        if name not in found:
            raise KeyError(f"no estimate of {name!r}; there are those of {', '.join(found) or 'none'}")
        return found[name]

    def document(self) -> dict[str, Any]:
        """The keys of ``lab fit --json``."""
        return {
            "base": self.model.base,
            "effects": list(self.model.effects),
            "parameters": {e.name: [_number(v) for v in (e.value, e.low, e.high)] for e in self.estimates},
            "units": {e.name: e.unit for e in self.estimates},
            "not_told": [e.name for e in self.estimates if not e.identified],
            "at_bound": [e.name for e in self.estimates if e.at_bound],
            "correlation": {
                "names": [e.name for e in self.estimates],
                "matrix": np.round(self.correlation, 4).tolist(),
            },
            "rms": dict(self.rms),
            "noise": dict(self.noise),
            "complete": self.complete,
            "stopped_early": self.stopped_early,
            "scale": [estimate.held_document() for estimate in self.held],
            "delay_s": self.delay_s,
        }


@dataclass(frozen=True)
class Ranked:
    """An effect that was tried: errors on unseen data without and with it, and its p-value.  is_identified: whether the
    interval of its size excludes zero, and its estimates agree with its definition, where the effect is significant."""

    effect: str
    rms_before: float
    rms_after: float
    p_value: float
    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """value, low, high (95 %) of each of its parameters."""
    is_identified: bool = True

    def document(self) -> dict[str, Any]:
        """One entry of ``ranking``."""
        numbers = {name: _number(getattr(self, name)) for name in ("rms_before", "rms_after", "p_value")}
        parameters = {name: [_number(v) for v in triple] for name, triple in self.parameters.items()}
        return {"effect": self.effect, **numbers, "parameters": parameters}


@dataclass(frozen=True)
class Errors:
    """Root mean square errors on unseen data, and of the noise."""

    before: float
    after: float
    noise: float
    unit: str

    def document(self) -> dict[str, Any]:
        """The key ``error``."""
        return {"before": _number(self.before), "after": _number(self.after), "noise": _number(self.noise),
                "unit": self.unit}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Curve:
    """The shape of what no effect explains: its mean over a variable with a 95 % band, each (K,).

    unit: the variable's; mean_unit: that of the mean, "" where it is not known.
    """

    variable: str
    unit: str
    x: FloatArray
    mean: FloatArray
    low: FloatArray
    high: FloatArray
    mean_unit: str = ""


@dataclass(frozen=True, eq=False)
class Finding:
    """The structure of the remaining error: the equation it acts on, the variables it depends on, in words and as a
    curve."""

    acts_on: str
    depends_on: tuple[str, ...]
    description: str
    curve: Curve | None = None
    formula: str | None = None

    def document(self) -> dict[str, Any]:
        """The key ``residual``."""
        found: dict[str, Any] = {"acts_on": self.acts_on, "depends_on": list(self.depends_on),
                                 "description": self.description, "formula": self.formula}  # fmt: skip
        if self.curve is not None:
            arrays = {name: getattr(self.curve, name).tolist() for name in ("x", "mean", "low", "high")}
            found["curve"] = {"variable": self.curve.variable, "unit": self.curve.unit, **arrays,
                              "mean_unit": self.curve.mean_unit}  # fmt: skip
        return found


@dataclass(frozen=True)
class Rung:
    """One step of the ladder: the active effects, the error on unseen data, the noise floor, its unit."""

    effects: tuple[str, ...]
    rms: float
    noise: float
    unit: str


@dataclass(frozen=True)
class InputLimit:
    """How well the recorded input lets the first column be predicted, where this is worse than the sensor's noise.

    step: of the readings of the input, in its unit, 0 where they are not rounded; rate_hz: of these readings; error:
    root mean square that they cause; sensor: that of the sensor's noise.  Noise of five times the error was added.
    """

    step: float
    rate_hz: float
    error: float
    sensor: float

    def document(self) -> dict[str, float]:
        """The key ``input_limit``."""
        return {"step": self.step, "rate_hz": self.rate_hz, "error": self.error, "sensor": self.sensor}


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Displayed):
    """What is missing from a model.

    missing: strongest first; confusable: groups that these recordings cannot distinguish; ranking: best first;
    detectable: for each effect the size of its main parameter (name, value) that would have been detected, where
    nothing is missing; base, best: the fits without and with the missing effects.
    """

    missing: tuple[str, ...]
    confusable: tuple[tuple[str, ...], ...]
    ranking: tuple[Ranked, ...]
    error: Errors
    residual: Finding | None
    advice: str
    detectable: Mapping[str, tuple[str, float]]
    base: Fit
    best: Fit
    share: Mapping[str, float] = field(default_factory=dict)
    """For each effect that is missing, the part of the squared error on unseen data that it takes."""
    rungs: tuple[Rung, ...] = ()
    """The errors on unseen data without the missing effects, with the first that was found, with the first two, …"""
    unshown: tuple[str, ...] = ()
    """Missing effects that only the data of the fit show: without them unseen data are predicted as well."""
    complete: bool = False
    """Whether the residual of ``best`` is noise."""
    columns: Mapping[str, Errors] = field(default_factory=dict)
    """The errors of each measured column in its own unit."""
    held: tuple[Estimate, ...] = ()
    """Parameters that these recordings cannot determine, with the values at which they were held."""
    untried: tuple[str, ...] = ()
    """Effects that were not tried because the time was up."""
    used_s: tuple[float, float] | None = None
    """Seconds of the recordings that the search used, and of all; None for searches that use all."""
    left_out: tuple[int, int] = (0, 0)
    """Numbers of segments of unseen data: those left out of the errors as lost, and all."""
    input_limit: InputLimit | None = None

    @property
    def verdict(self) -> Verdict:
        """What was found."""
        return "missing" if self.missing else "nothing_missing" if self.complete else "outside_catalogue"

    @property
    def unidentified(self) -> tuple[Ranked, ...]:
        """Effects that significantly leave less than what is missing, by as much as is worth a name, and are not named
        as they are not identified."""
        may = (one for one in self.ranking if not one.is_identified and one.effect not in self.missing)
        return tuple(
            one for one in may
            if one.p_value < policy.FALSE_NAME and policy.is_less(one.rms_after, self.error.after)
        )  # fmt: skip

    def document(self) -> dict[str, Any]:
        """The keys of ``lab explain --json``."""
        return {
            "verdict": self.verdict,
            "missing": list(self.missing),
            "confusable": [list(group) for group in self.confusable],
            "ranking": [entry.document() for entry in self.ranking],
            "error": self.error.document(),
            "complete": self.complete,
            "share": {effect: _number(share) for effect, share in self.share.items()},
            "columns": {name: errors.document() for name, errors in self.columns.items()},
            "scale": [estimate.held_document() for estimate in self.held],
            "delay_s": self.best.delay_s,
            "untried": list(self.untried),
            "used": {"seconds": self.used_s[0], "of": self.used_s[1]} if self.used_s else None,
            "input_limit": self.input_limit.document() if self.input_limit else None,
            "left_out": {"segments": self.left_out[0], "of": self.left_out[1]},
            "residual": self.residual.document() if self.residual else None,
            "advice": self.advice,
            "detectable": {effect: {name: _number(size)} for effect, (name, size) in self.detectable.items()},
            "parameters": {e.name: [_number(v) for v in (e.value, e.low, e.high)] for e in self.best.estimates},
            "effects": list(self.best.model.effects),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Ladder(Displayed):
    """How the error fell, effect by effect; last: the explanation that added nothing more."""

    last: Explanation

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """The errors with one effect after the other."""
        return self.last.rungs

    def document(self) -> dict[str, Any]:
        """The keys of ``lab improve --json``: those of explain, and the ladder."""
        rungs = [{"effects": list(r.effects), "rms": _number(r.rms), "noise": _number(r.noise)} for r in self.rungs]
        return {**self.last.document(), "ladder": rungs}


def _number(value: float) -> float | None:
    """The value; None for NaN and infinity, which JSON cannot represent."""
    return float(value) if np.isfinite(value) else None


def ladder_of(explanation: Explanation) -> Ladder:
    """How the error fell in a search."""
    return Ladder(explanation)
