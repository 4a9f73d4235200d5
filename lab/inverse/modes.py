"""The ring-down of a structure with more modes than the catalogue has, band-limited to its strongest one.

A modal analysis looks at one mode at a time, within its band, and leaves the others to a residual (Ewins 2000, Modal
Testing, sections 4.2 and 4.4).  The bar of the model has one mode, and the catalogue a second one; an accelerometer on
a struck beam feels a dozen, in the first tenths of a second as large as these.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.frequency_response import spectral_lines
from lostmotion.lab.fitting.identifiability import is_driven
from lostmotion.lab.inverse.signals import EDGE, FASTEST, PER_PERIOD, WHOLE
from lostmotion.lab.inverse.zero_phase import lowpass
from lostmotion.model import Model

__all__ = ["band_limited"]

MODES = 2
"""Of the model and the catalogue: where there are no more, all are compared."""
log = logging.getLogger(__name__)


def band_limited(model: Model, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments, those of an accelerometer on a bar that rings down in many modes within the band of its
    strongest one; a warning reports the others."""
    return tuple(_limited(one) if model.base == "oscillator" else one for one in experiments)


def _limited(experiment: Experiment) -> Experiment:
    rate, values = experiment.rate_hz, experiment.measured.get(ACCEL)
    if values is None or len(experiment.measured) > 1 or is_driven(experiment):
        return experiment
    lines = spectral_lines(values, rate)
    cutoff = WHOLE * lines[0] if lines else np.inf
    beyond = [line for line in lines if line > cutoff]
    if len(beyond) < MODES or cutoff > FASTEST * rate:
        return experiment
    log.warning(
        "%s: has further modes, at %s Hz; the motion is compared below %.3g Hz",
        experiment.name, ", ".join(f"{line:.4g}" for line in sorted(beyond)), cutoff,
    )  # fmt: skip
    seen = ~np.isnan(values)
    time = np.arange(experiment.time[seen][0], experiment.time[seen][-1], 1 / rate)
    smooth = lowpass(np.interp(time, experiment.time[seen], values[seen]), cutoff / rate)
    kept = slice(round(EDGE * rate / cutoff), None, max(int(rate / cutoff / (WHOLE * PER_PERIOD)), 1))
    return replace(experiment, time=time[kept], measured={ACCEL: smooth[kept]})
