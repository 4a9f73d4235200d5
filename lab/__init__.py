"""The lab compares a model with measurements.  This module holds its API for notebooks and user-defined effects.

>>> model = build_model("servo", ["viscous_friction"])
>>> with open_executor() as pool:
...     found = explain(model, experiments(model, [read_recording(path) for path in paths]), pool)

Each name is imported from its module when it is first used (PEP 562): the help of the lab's commands imports this
module too, and needs none of them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lostmotion.drivers.recording import read_recording
    from lostmotion.lab.comparison.compare import compare
    from lostmotion.lab.data.experiment import experiments
    from lostmotion.lab.estimate import fit
    from lostmotion.lab.explanation import explain
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

_MODULES = {
    "Parameter": "lostmotion.model",
    "build_model": "lostmotion.model",
    "compare": "lostmotion.lab.comparison.compare",
    "effect": "lostmotion.lab.models.own",
    "experiments": "lostmotion.lab.data.experiment",
    "explain": "lostmotion.lab.explanation",
    "fit": "lostmotion.lab.estimate",
    "ladder_of": "lostmotion.lab.results",
    "open_executor": "lostmotion.lab.parallel",
    "read_recording": "lostmotion.drivers.recording",
    "write_report": "lostmotion.lab.report",
}


def __getattr__(name: str) -> Any:
    """The object of that name, imported from its module."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(import_module(_MODULES[name]), name))


def __dir__() -> list[str]:
    """The names that are there, imported or not."""
    return sorted({*globals(), *__all__})
