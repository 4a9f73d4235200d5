"""The median is NumPy's, without the imports of NumPy's function."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from lostmotion.detector.median import median, medians


@pytest.mark.parametrize("count", [1, 2, 3, 8, 247])
def test_it_is_numpys_median(count: int) -> None:
    """Of odd and even numbers of values, also where some are infinite; NaN where one is."""
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
    values[0] = np.inf
    assert median(values) == np.median(values)
    values[0] = np.nan
    assert np.isnan(median(values))


def test_medians_of_runs() -> None:
    """Of runs of one to hundreds of values, with equal and infinite ones, each is NumPy's median."""
    random = np.random.default_rng(5)
    ends = np.concatenate([[0], np.cumsum(random.integers(1, 300, 120))])
    values = np.round(random.normal(size=ends[-1]), 1)
    values[random.integers(0, values.size, 5)] = np.inf
    assert np.array_equal(medians(values, ends), [np.median(run) for run in np.split(values, ends[1:-1])])


def test_learning_imports_no_masked_arrays() -> None:
    """Noise, bar and severity are learnt, and a trend is found, without ``numpy.ma``."""
    program = """if True:
        import sys
        import numpy as np
        from lostmotion.detector.learner import Learner
        from lostmotion.detector.normalise import normalised
        from lostmotion.detector.severity import severity
        from lostmotion.detector.trend import mann_kendall, theil_sen
        from lostmotion.detector.window import DetectorSettings, Window
        settings, random = DetectorSettings(f_res_hz=58.0), np.random.default_rng(1)
        learner = Learner(settings, 1000.0, 250)
        for accel in random.normal(size=(50, 250)):
            learner.update(accel)
        learner.finish()
        assert learner.background is not None
        time = np.arange(450) / 1000
        assert severity(Window("j", 0.0, 0.45, time, random.normal(size=450), 1000.0), (), (), 9.0, settings).high > 0
        ages = np.arange(300.0)
        scores, _ = normalised(np.exp(ages / 300), {"excitation": random.normal(size=300)})
        assert mann_kendall(scores).direction == "rising" and theil_sen(ages, scores).low > 0
        sys.exit("numpy.ma" in sys.modules)
    """
    assert subprocess.run([sys.executable, "-c", program], timeout=60, check=False).returncode == 0
