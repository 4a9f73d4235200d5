"""The signals that reports and figures draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.report.views import traces
from lostmotion.lab.results import Fit
from lostmotion.model import build_model


def test_the_signal_of_another_fit_has_the_zero_of_the_measured_one() -> None:
    """Each fit of a free motion counts the angle from a zero of its own: the residual of the fit without the missing
    effects is the one of that fit."""
    time = np.arange(0.0, 1.0, 0.02)
    one = Experiment("swing.csv", None, time, {"position": 0.5 * np.cos(5 * time)})
    model = build_model("joint")
    best = Fit(model, (one,), (np.zeros(2),), (), np.eye(0), {"position": 1e-3}, {"position": 0.1}, 1e-3)
    elsewhere = replace(one, measured={"position": one.measured["position"] + 100.0})
    base = replace(best, experiments=(elsewhere,), starts=(np.array([100.0, 0.0]),))
    (trace,) = traces(best, before=base)
    assert trace.before is not None
    assert trace.before == pytest.approx(np.zeros(time.size), abs=1e-9)
