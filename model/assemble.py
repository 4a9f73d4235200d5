"""From a base, effects and values to the solver's tables.  No physics, no integration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lostmotion.model.base import Base
from lostmotion.model.effects.base import Effect
from lostmotion.model.effects.registry import rank
from lostmotion.model.kernel import Kernel
from lostmotion.model.rk4 import FloatArray, IntArray, Plan
from lostmotion.model.signals import DRIVEN, SIGNALS, TIME
from lostmotion.model.solve import SPEED

__all__ = ["LAYER", "assemble", "in_order", "scope"]

LAYER = 4.0
"""Widths of the change of sign of a dry friction up to which steps are short: tanh(4) is 1 - 7e-4.  With 6 and 10 a
pendulum that dry friction stops is as far from Radau's (docs/decisions/0001)."""


@dataclass(frozen=True)
class _Step:
    """One call of a kernel: its place in the order, its target, the full names of its parameters, where its states
    begin."""

    place: tuple[int, int]
    target: int
    kernel: Kernel
    names: tuple[str, ...]
    states_at: int = 0
    has_states: bool = False


def in_order(effects: Sequence[Effect]) -> list[Effect]:
    """The effects in the order of their evaluation, which is also that of their states."""
    return sorted(effects, key=lambda effect: rank(effect.id))


def scope(values: Mapping[str, float], effect: Effect | None = None) -> dict[str, float]:
    """What a term sees: the base's values, and those of its effect under their short names."""
    seen = {key: value for key, value in values.items() if "." not in key}
    if effect is not None:
        seen.update({name: values[f"{effect.id}.{name}"] for name in effect.parameters})
    return seen


def assemble(base: Base, effects: Sequence[Effect], values: Mapping[str, float]) -> tuple[Plan, Plan]:
    """The tables of rk4.Plan for a base with effects (in_order), without and with an input."""
    tables = _tables(base, tuple(effects))
    start = tables.start.copy()
    for signal, preset in base.presets.items():
        start[signal] = values[preset] if isinstance(preset, str) else preset
    speed = base.states[SPEED].signal
    every = (effect.sign_width(scope(values, effect), speed) for effect in effects if effect.sign_width)
    widths = [width for width in every if width > 0]
    p, layer = [values[name] for name in tables.names], [LAYER * max(widths, default=0.0), min(widths, default=0.0)]
    free = np.array([*p, 0.0, *start[tables.reset], *start, *layer])
    driven = free.copy()
    driven[tables.plan.start_at + DRIVEN] = 1.0
    return tables.plan._replace(constants=free), tables.plan._replace(constants=driven)


@dataclass(frozen=True)
class _Tables:
    """What does not depend on values: a plan without them, the parameters' names in its order, the signals to begin
    with, and which signals are set again in each evaluation."""

    plan: Plan
    names: tuple[str, ...]
    start: FloatArray
    reset: list[int]


@lru_cache(maxsize=256)  # a search evaluates a few dozen models thousands of times
def _tables(base: Base, effects: tuple[Effect, ...]) -> _Tables:
    steps = sorted([*_base_steps(base, effects), *_effect_steps(base, effects)], key=_place)
    states = [state.signal for state in base.states]
    own = sum(len(effect.states) for effect in effects)
    given = {*base.presets, *states, *(signal for signal, _ in base.input_signals)}
    targets = [step.target for step in steps]
    reset = [signal for signal in base.presets if signal in targets]
    rates = [state.rate for state in base.states]
    needed = [i for i, step in enumerate(steps) if step.has_states or step.target in rates]
    lengths = [len(step.names) for step in steps]
    plan = Plan(
        addresses=np.array([step.kernel.address for step in steps], dtype=np.uint64),
        targets=_table(targets),
        fresh=_table([t not in given and t not in targets[:i] for i, t in enumerate(targets)]),
        p_at=_table(np.cumsum([0, *lengths[:-1]])),
        x_at=_table([SIGNALS + step.states_at for step in steps]),
        dx_at=_table([len(states) + step.states_at for step in steps]),
        live=max(needed) + 1,
        state_at=_table([*states, *range(SIGNALS, SIGNALS + own)]),
        rate_signals=_table(rates),
        input_signals=_table([signal for signal, _ in base.input_signals]),
        input_orders=_table([order for _, order in base.input_signals]),
        presets=_table(reset),
        time=TIME,
        watch=base.watched,
        constants=np.empty(0),
        start_at=sum(lengths) + 1 + len(reset),
    )
    return _Tables(plan, tuple(name for step in steps for name in step.names), np.zeros(SIGNALS + own), reset)


def _base_steps(base: Base, effects: Sequence[Effect]) -> Iterator[_Step]:
    touched = {term.target for effect in effects for term in effect.terms.get(base.id, ())}
    fused: set[int] = set()
    for fusion in base.fusions:
        if not touched & set(fusion.covers[:-1]) and not fused & set(fusion.covers):
            fused |= set(fusion.covers)
            # It runs where the first of its terms would, so that all it sets is there for effects in between.
            yield _Step((fusion.covers[0], -1), fusion.covers[-1], fusion.kernel, fusion.parameters)
    for term in base.terms:
        if term.target not in fused:
            yield _Step((term.target, -1), term.target, term.kernel, term.parameters)


def _effect_steps(base: Base, effects: Sequence[Effect]) -> Iterator[_Step]:
    states_at = 0
    for place, effect in enumerate(effects):
        for term in effect.terms.get(base.id, ()):
            names = tuple(f"{effect.id}.{name}" if name in effect.parameters else name for name in term.parameters)
            yield _Step((term.target, place), term.target, term.kernel, names, states_at, bool(effect.states))
        states_at += len(effect.states)


def _place(step: _Step) -> tuple[int, int]:
    return step.place


def _table(numbers: Sequence[int] | IntArray) -> IntArray:
    return np.asarray(numbers, dtype=np.int64)
