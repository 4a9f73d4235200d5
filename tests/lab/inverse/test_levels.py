"""What is worth a name, and how often a name is false: torques in closed form, of joints that move in sines."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.inverse.likelihood import Fitted, Method, WholeMotion
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.forward import selected
from lostmotion.lab.selection.search import Selection
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray

MODEL = build_model("joint", ["viscous_friction"])


def joint(seed: int, length: float, fastest: float, coulomb: float, disturbance: FloatArray) -> Recording:
    """J = 0.4 kg m² and viscous friction of 2 N m s/rad, with dry friction and a disturbance (N,) [N m]; four sines of
    a third of the fastest frequency [Hz] and more."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, length, 0.01)
    f, phase = rng.uniform(fastest / 3, fastest, 4), rng.uniform(0, 2 * np.pi, 4)
    w, x = 2 * np.pi * f, np.multiply.outer(t, 2 * np.pi * f) + phase
    angle, speed = (0.4 / f * np.sin(x)).sum(axis=1), (0.4 / f * w * np.cos(x)).sum(axis=1)
    torque = 0.4 * (-0.4 / f * w**2 * np.sin(x)).sum(axis=1) + 2 * speed + coulomb * np.sign(speed) + disturbance
    columns = {"torque": torque, "position": angle + 1e-4 * rng.standard_normal(t.size)}
    return Recording(t, columns, {}, {}, 0, f"joint{seed}.csv")


def search(recordings: list[Recording], is_fold: bool = False) -> Selection[Fitted]:
    """What is found in the recordings; is_fold: in all but the last, which is predicted as one more fold."""
    signals = [Signals.of(one) for one in experiments(MODEL, recordings)]
    unseen = signals.pop() if is_fold else None
    return selected(WholeMotion(Method.TORQUE, MODEL, signals, unseen, is_fold), lambda what, part: None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("coulomb", "least", "most", "added"), [(0.078, 0.03, 0.047, ()), (0.095, 0.053, 0.075, ("coulomb_friction",))]
)
def test_what_takes_less_than_a_twentieth_of_the_error_is_not_named(
    coulomb: float, least: float, most: float, added: tuple[str, ...]
) -> None:
    """Beside white noise of 0.5 N m dry friction of 0.078 N m is beyond doubt (p < 0.001), but takes 4 % of the squared
    error: it has no name.  Friction of 0.095 N m takes 6 % and has one."""
    noise = np.random.default_rng(1).standard_normal((2, 10_000)) / 2
    found = search([joint(seed, 100.0, 6.0, coulomb, noise[seed]) for seed in (0, 1)])
    (friction,) = (one for one in found.steps[0].judged if one.effect == "coulomb_friction")
    assert friction.p_value < 1e-3
    assert least < friction.gain < most
    assert found.added == added


def coloured(seed: int) -> Recording:
    """Six seconds with a disturbance of 0.3 N m that changes within a tenth of a second; nothing is missing."""
    rng = np.random.default_rng(seed)
    smooth = gaussian_filter1d(rng.standard_normal(800), 12)[100:-100]
    return joint(seed, 6.0, 1.2, 0.0, 0.3 * smooth / smooth.std())


@pytest.mark.slow
@pytest.mark.parametrize(("number", "p_value", "added"), [(56, 0.048, ("coulomb_friction",)), (191, 0.116, ())])
def test_a_false_name_is_as_rare_as_its_level(number: int, p_value: float, added: tuple[str, ...]) -> None:
    """Of 300 searches in one short recording, with a judged one as a further fold, two named an effect although nothing
    is missing (5 % are allowed): those with p = 0.025 and 0.048.  The next had 0.116, 0.16 and 0.23."""
    found = search([coloured(2 * number), coloured(2 * number + 1)], is_fold=True)
    apt = [one.p_value for one in found.steps[0].judged if one.gain > 0.05 and one.is_identified]
    assert min(apt) == pytest.approx(p_value, rel=0.15)
    assert found.added == added
