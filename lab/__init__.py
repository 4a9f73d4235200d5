"""The lab compares a model with measurements.  This module holds its API for notebooks and user-defined effects.

>>> model = build_model("servo", ["viscous_friction"])
>>> with open_executor() as pool:
...     found = explain(model, experiments(model, [read_recording(path) for path in paths]), pool)

``compare``, ``explain`` and ``fit`` are the functions; the modules of these names are imported by their full names.
"""

from lostmotion.drivers.recording import read_recording
from lostmotion.lab.comparison.compare import compare
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.estimate import fit
from lostmotion.lab.explain import explain
from lostmotion.lab.models.own import effect
from lostmotion.lab.parallel import open_executor
from lostmotion.lab.report import write_report
from lostmotion.lab.results import ladder_of
from lostmotion.model import Parameter, build_model

__all__ = [
    "Parameter",
    "build_model",
    "compare",
    "effect",
    "experiments",
    "explain",
    "fit",
    "ladder_of",
    "open_executor",
    "read_recording",
    "write_report",
]
