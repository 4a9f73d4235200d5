"""The error of a prediction that comes from the recorded input: from its samples and from its steps.

The command of a servo is known a hundred times a second, in steps of its encoder.  No model that is driven by it can
predict better: an error of the command of 0.6 mrad, beside a play of 3 mrad, shifts every impact.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.rounded_input import drawn_again
from lostmotion.lab.fitting.fit import rms_by_column
from lostmotion.lab.gears.unseen import Unseen
from lostmotion.lab.results import InputLimit
from lostmotion.lab.shooting.task import DITHER, Task
from lostmotion.model import Model, ModelError, Sampled

__all__ = ["InputError", "input_error"]

TOLERATED = 3.0
"""Least ratio of the noise to the error of the input on longer segments, see ``DITHER``."""


@dataclass(frozen=True)
class InputError:
    """The error that the input causes.

    columns: root mean square in the shortest segments, the median over the segments; longest_s: length of the longest
    segments in which the error is small beside the noise, infinite where it is small in whole recordings [s].
    """

    columns: Mapping[str, float]
    longest_s: float

    def share(self, noise: Mapping[str, float]) -> float:
        """The share of the squared noise of the main column that the input causes."""
        column = next(iter(noise))
        return float((self.columns[column] / noise[column]) ** 2)

    def limit(self, experiment: Experiment, noise: Mapping[str, float]) -> InputLimit | None:
        """What is reported of it: the error of the main column, if it is not small beside the noise of the sensor."""
        column, drive = next(iter(noise)), experiment.drive
        error = self.columns[column]
        if not isinstance(drive, Sampled) or DITHER * error <= noise[column]:
            return None
        return InputLimit(experiment.drive_step, float(1 / np.median(np.diff(drive.time))), error, noise[column])


def input_error(model: Model, experiment: Experiment, noise: Mapping[str, float], pool: Executor) -> InputError:
    """The error of an experiment that its input causes, if the motion is that of the model.

    The model moves with another input that the readings tell as well.  With the present input this motion is then
    predicted in segments with fitted initial states.  An input in closed form has no error, and that of a model which
    cannot be simulated is not known.  noise: root mean square of the noise of each column.
    """
    made = _moved(model, experiment)
    errors = _errors(model, made, dict(noise), pool) if made else iter(())
    shortest, columns = next(errors, (np.inf, dict.fromkeys(noise, 0.0)))
    least = {name: max(noise[name], DITHER * error) / TOLERATED for name, error in columns.items()}
    longest_s = shortest
    for length_s, longer in errors:
        if any(error > least[name] for name, error in longer.items()):
            return InputError(columns, longest_s)
        longest_s = length_s
    return InputError(columns, np.inf)


def _errors(
    model: Model, made: Experiment, noise: dict[str, float], pool: Executor
) -> Iterator[tuple[float, dict[str, float]]]:
    """The length of segments [s], and the median error of each column in them; each twice as long as the last ones."""
    task = Task.of(model, [made], noise)
    for halvings in range(task.halvings, -1, -1):
        length_s = made.duration / 2**halvings
        found = Unseen(made, task, length_s, pool).validate(model)
        parts = [rms_by_column([pair]) for pair in zip(found.segments, found.parts, strict=True)]
        errors = {name: float(np.median([part[name] for part in parts if name in part])) for name in noise}
        if not np.isfinite(list(errors.values())).all():
            return
        yield length_s, errors


def _moved(model: Model, experiment: Experiment) -> Experiment | None:
    """The experiment with the motion that the model makes of its input, and with another input; None where it cannot be
    simulated, or the input is no recorded one."""
    if not isinstance(experiment.drive, Sampled):
        return None
    with suppress(ModelError):
        moved = experiment.model(model).simulate(experiment.drive, experiment.time)
        measured = {
            name: np.where(np.isfinite(values), moved[name], np.nan) for name, values in experiment.measured.items()
        }
        drive = drawn_again(experiment.drive, experiment.drive_step, np.random.default_rng(0))
        return replace(experiment, drive=drive, measured=measured)
    return None
