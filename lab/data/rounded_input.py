"""An input that is known in steps only: the command of a servo, read over its bus in units of its encoder.

The commands of a hobby servo are multiples of 1.5 to 5 mrad, read a hundred times a second; a play is 1 to 10 mrad.
The shaft moves smoothly.  A spline through the rounded values would accelerate by some 20 rad/s² at every step.
"""

from __future__ import annotations

import numpy as np

from lostmotion.lab.data.series import resolution
from lostmotion.model import Sampled
from lostmotion.model.motion import FloatArray

__all__ = ["drawn_again", "rounding_step", "smooth_motion"]

ROUNDED, LEAST_LEVELS = 1e-5, 10
"""Least step, as a share of the range of the values, and least number of different values, of a motion in steps.  What
smaller ones change is less than the error of integration; two values of a motion that is not rounded differ by 2 to
9e-6 of its range at the least (400 samples).  Fewer values may be goals, between which it jumps; four seconds moved by
hand by 20 mrad in steps of 5.1 mrad have 13, in steps of 1.5 mrad 43."""
OFF_GRID = 0.1
"""Largest distance of a value from a multiple of the step, in steps: 0 of exact multiples, 0.04 of 64 values in steps
of 5.1 mrad that were printed with five decimals, 0.5 of values that are not rounded.  As the step is the least
difference of two values, more values, or fewer decimals, count as not rounded (0.2 of 202 values, 0.18 with four
decimals)."""
DEGREE = 5
"""Of the spline through the samples of a motion.  A command at 100 Hz of a hand-waved motion up to 3 Hz, with impacts
that amplify each error, is predicted with 12 times the noise by cubic splines, and with 1.01 times by quintic ones."""
ORDER, KNOTS = 4, 2.0
"""Order of the differences that are penalised, and the spacing of the knots in samples.  Of six motions up to 3 Hz at
100 Hz, in steps of 1.5 and 5.1 mrad, orders of 2, 3 and 4 leave 0.55, 0.46 and 0.41 of the rounding error in the
angle, and 0.56, 0.27 and 0.21 rad/s² in accelerations of 10 rad/s² (at 5.1 mrad)."""
SEARCHED = (-6.0, 20.0)
"""Range of the decimal logarithm of the penalty's weight."""


def rounding_step(values: FloatArray) -> float:
    """The step whose multiples all values (N,) are, up to an offset; 0 for values that are not rounded."""
    values = values[np.isfinite(values)]
    step = resolution(values)
    if step <= ROUNDED * float(np.ptp(values)) or np.unique(values).size < LEAST_LEVELS:
        return 0.0
    levels = (values - values.min()) / step
    return step if np.abs(levels - np.round(levels)).max() < OFF_GRID else 0.0


def smooth_motion(time: FloatArray, values: FloatArray, step: float) -> Sampled:
    """The motion whose positions were read as these values (N,), at these times (N,) [s]; step: to which they were
    rounded, 0 for none.

    Values with steps of q have errors of variance q²/12.  The motion f is the penalised spline (Eilers and Marx,
    Statistical Science 11, 1996, 89-121) with this mean square error (Reinsch, Numerische Mathematik 10, 1967,
    177-183).  Cross-validation follows the steps where the motion is slow, as the errors are not independent there:
    1.3 mrad are left of steps of 5.1 mrad, and 0.5 mrad this way.
    """
    return Sampled(time, _smoothed(time, values, step) if step else values, DEGREE)


def drawn_again(motion: Sampled, step: float, rng: np.random.Generator) -> Sampled:
    """Another motion that rounded readings tell as well, with errors that are independent of those of the first one:
    the first one is rounded to another grid of steps, and smoothed again.  Without rounding (a step of 0) it is the
    motion with the error of interpolation, estimated by that of a cubic spline."""
    if not step:
        return Sampled(motion.time, motion.values)
    shift = rng.uniform(0.0, step)
    read = np.round((motion.values + shift) / step) * step - shift
    return Sampled(motion.time, _smoothed(motion.time, read, step), motion.degree)


def _smoothed(time: FloatArray, values: FloatArray, step: float) -> FloatArray:
    """The penalised spline with a mean square error of step²/12, at the times (N,); the values where there is none."""
    from scipy.interpolate import BSpline
    from scipy.optimize import brentq
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    at = (time - time[0]) / (KNOTS * float(np.median(np.diff(time))))
    basis = BSpline.design_matrix(at, np.arange(-DEGREE, np.floor(at[-1]) + DEGREE + 2), DEGREE).tocsc()
    size = basis.shape[1]
    weights = np.diff(np.eye(ORDER + 1), ORDER, axis=0)[0]
    difference = diags_array(weights, offsets=range(ORDER + 1), shape=(size - ORDER, size)).tocsc()
    normal, penalty, right = basis.T @ basis, difference.T @ difference, np.asarray(values @ basis)

    def smooth(exponent: float) -> FloatArray:
        return np.asarray(basis @ splu(csc_array(normal + 10.0**exponent * penalty)).solve(right))

    def excess(exponent: float) -> float:
        return float(np.mean((smooth(exponent) - values) ** 2)) * 12 / step**2 - 1

    low, high = SEARCHED
    if excess(low) > 0:  # a motion that jumps: no smooth one is near
        return values
    return smooth(high if excess(high) < 0 else float(brentq(excess, low, high, xtol=0.05)))
