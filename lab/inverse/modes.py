"""The band of the strongest modes of a structure that rings down.

``band_limited`` leaves out the higher modes of a structure that has more modes than model and catalogue.  A modal
analysis looks at a few modes at a time, within their band, and leaves the others to a residual (Ewins 2000, Modal
Testing, sections 4.2 and 4.4).  The bar of the model has one mode, and the catalogue has a second one; an accelerometer
on a struck beam feels a dozen, which in the first tenths of a second are as large as these.

It is applied before any fit of a search (lab/explanation.py).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.clipping import clipping_level
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.frequency_response import spectral_lines
from lostmotion.lab.inverse.signals import CUTOFF, EDGE, FASTEST, PER_PERIOD
from lostmotion.lab.inverse.zero_phase import lowpass
from lostmotion.model import Model

__all__ = ["band_limited"]

MODES = 2
"""Number of modes of model and catalogue; the band is limited only where a recording has more."""
HARMONICS, INHARMONIC = 5, 0.025
"""Harmonics of the strongest mode that are no modes, and how far off they may be, as a frequency depends on the
amplitude.  A struck beam whose clamp slips has lines at 2, 3 and 5 times its 7.8 Hz, and modes at 50 and 142 Hz."""
log = logging.getLogger(__name__)


def band_limited(model: Model, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments; those of an accelerometer on an oscillator that rings down are filtered to a band with as many
    modes as model and catalogue have, the same for all, or to that of the strongest mode where the next two are too
    near to each other.  A warning reports the other modes.  Readings that are cut off at the end of the range are left
    as they are: their harmonics are no modes."""
    modes = [_modes(one) if model.base == "oscillator" and _is_felt_ringing(one) else [] for one in experiments]
    more = [found for found in modes if len(found) > MODES]
    highest = FASTEST * min((one.rate_hz for one in experiments), default=0.0)
    apart = [math.sqrt(second * third) for _, second, third, *_ in more if third > CUTOFF * second]
    two = [end for end in apart if end < highest]
    end = min(two or [CUTOFF * first for first, *_ in more], default=math.inf)
    return tuple(_below(end, one, found) if found else one for one, found in zip(experiments, modes, strict=True))


def _is_felt_ringing(experiment: Experiment) -> bool:
    """Whether these are the readings of an accelerometer alone, within its range, and nothing drives the motion."""
    is_alone = experiment.measured.keys() == {ACCEL} and not experiment.is_driven
    return is_alone and not clipping_level([experiment])


def _modes(experiment: Experiment) -> list[float]:
    """The frequencies of the strongest mode and of those beyond its band, ascending [Hz], without its harmonics."""
    first, *others = spectral_lines(experiment.measured[ACCEL], experiment.rate_hz) or (math.inf,)
    beyond = [line for line in others if line > CUTOFF * first]
    return [first, *sorted(line for line in beyond if not _is_harmonic(line / first))]


def _is_harmonic(ratio: float) -> bool:
    """Whether a line at this ratio to the strongest mode is its harmonic, as of a clamp that slips."""
    order = round(ratio)
    return order <= HARMONICS and abs(ratio - order) < INHARMONIC * order


def _below(end: float, experiment: Experiment, modes: Sequence[float]) -> Experiment:
    """The experiment below this frequency [Hz], sampled as that needs; modes: its frequencies [Hz]."""
    rate, values = experiment.rate_hz, experiment.measured[ACCEL]
    if end > FASTEST * rate:
        return experiment
    if beyond := [line for line in modes if line > end]:
        log.warning(
            "%s: has further modes, at %s Hz; the motion is compared below %.3g Hz",
            experiment.name, ", ".join(f"{line:.4g}" for line in beyond), end,
        )  # fmt: skip
    seen = ~np.isnan(values)
    time = np.arange(experiment.time[seen][0], experiment.time[seen][-1], 1 / rate)
    smooth = lowpass(np.interp(time, experiment.time[seen], values[seen]), end / rate)
    kept = slice(round(EDGE * rate / end), None, max(int(rate / end / (CUTOFF * PER_PERIOD)), 1))
    return replace(experiment, time=time[kept], measured={ACCEL: smooth[kept]})
