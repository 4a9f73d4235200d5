"""What a base is: terms, states, input and outputs as one value.  No equations here; each base has its own file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from lostmotion.model.kernel import Kernel
from lostmotion.model.parameter import Parameter

__all__ = ["Base", "Fusion", "Operating", "State", "Term"]


@dataclass(frozen=True)
class Term:
    """A contribution to one signal: its target, its kernel, and the names of the parameters the kernel gets as p."""

    target: int
    kernel: Kernel
    parameters: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fusion:
    """One kernel that does the work of several consecutive terms, for speed.

    It sets the signals of all ``covers`` but the last itself and returns the contribution to the last.  It is used only
    while no effect acts on the signals that it sets itself, and must give what the single terms give.
    """

    covers: tuple[int, ...]
    kernel: Kernel
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class State:
    """A state of a base: its name, the signal that shows it, the signal that is its derivative."""

    name: str
    signal: int
    rate: int


@dataclass(frozen=True)
class Operating:
    """What the choice of the sub-step knows of the motion, before or after a first run.

    speed, acceleration: largest of the input's first and second derivative; watched: largest magnitude of the base's
    watched signal, None before the first run; inertia: J2 or J [kg m²], NaN where there is none.
    """

    speed: float
    acceleration: float
    watched: float | None
    inertia: float


@dataclass(frozen=True, eq=False)
class Base:
    """The body of a model, to which effects are added; equal only to itself.

    states: the solver integrates them; input_signals: signals that carry the input, with the order of the derivative
    (0 or 1); presets: signals that begin at a parameter's value (the inertia) or at a number; outputs: the names under
    which signals leave; rate: the fastest rate [rad/s] of the base, of which a sub-step covers at most a quarter;
    watched: the signal from which the solver chooses its sub-step; scale: the parameter with which all forces can be
    scaled without a change of the motion, where no input drives it; start: states that move along with an input, from
    the values, the input and its two derivatives.
    """

    id: str
    equation: str
    summary: str
    parameters: Mapping[str, Parameter]
    states: tuple[State, ...]
    terms: tuple[Term, ...]
    outputs: Mapping[str, int]
    watched: int
    rate: Callable[[Mapping[str, float], Operating], float]
    start: Callable[[Mapping[str, float], float, float, float], tuple[float, ...]]
    input_signals: tuple[tuple[int, int], ...] = ()
    presets: Mapping[int, str | float] = field(default_factory=dict)
    scale: str = ""
    fusions: tuple[Fusion, ...] = ()
    """Those that cover most first."""
