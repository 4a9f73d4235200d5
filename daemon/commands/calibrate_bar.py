"""``lostmotion calibrate bar``: the length of a bar for a resonance.  The numbers are detector/cantilever.py's."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import click

from lostmotion.daemon.commands.calibrate_common import CalibrationError, lines_of, report, toml_out
from lostmotion.daemon.commands.options import as_json, positive
from lostmotion.detector.cantilever import MATERIALS, Beam, frequencies, length_for, rectangle, rod
from lostmotion.detector.play_size import LEAST_RATE

__all__ = ["calibrate_bar"]

FACTORS = {"m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3}, "kg": {"kg": 1.0, "g": 1e-3}}
SLENDER = 10.0
"""length by thickness; a shorter bar is softer than a cantilever of Euler's and Bernoulli's"""
NO_TIP = "--tip is not given, so this is the bare bar: with a sensor at its end it rings lower (5 g may halve it)"
CLAMP = "a real one gives a little, and the bar rings lower: leave length to push in, and measure with calibrate tap"


def lengths(name: str, text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """An option for a length, as in 10mm."""
    return click.option(name, callback=quantity("m"), metavar="LENGTH", help=text)


def quantity(unit: str) -> Callable[[click.Context, click.Parameter, str | None], float | None]:
    """A callback that takes a number and its unit to SI."""

    def convert(ctx: click.Context, param: click.Parameter, value: str | None) -> float | None:
        try:
            return None if value is None else _parsed(value, unit)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from error

    return convert


def _parsed(text: str, unit: str) -> float:
    """A number with its unit, in SI.  Raises ValueError."""
    factors = FACTORS[unit]
    found = re.fullmatch(r"\s*(\d*\.?\d+(?:e-?\d+)?)\s*([a-z]+)\s*", text)
    if found is None or found[2] not in factors:
        raise ValueError(
            f"found {text!r}, expected a number and a unit ({', '.join(factors)}), as in 10{[*factors][-1]}"
        )
    value = float(found[1]) * factors[found[2]]
    if not math.isfinite(value):
        raise ValueError(f"found {text!r}, expected a finite number")
    return value


@click.command("bar", short_help="How long a bar must be for a frequency, before it is cut.")
@click.option("--material", type=click.Choice(tuple(MATERIALS)), default="steel", show_default=True, help="Of the bar.")
@lengths("--width", "Of a flat bar, as in 10mm.")
@lengths("--thickness", "Of a flat bar, across which it bends, as in 1mm.")
@lengths("--diameter", "Of a round rod, instead of width and thickness.")
@click.option(
    "--tip", callback=quantity("kg"), metavar="MASS", help="Sensor, screws and glue, as in 5g.  [default: 0g]"
)
@click.option("--frequency", type=float, callback=positive, metavar="HZ", help="The resonance that is wanted [Hz].")
@lengths("--length", "Of a bar that is there: which resonance has it?")
@toml_out
@as_json
def calibrate_bar(
    material: str,
    tip: float | None,
    frequency: float | None,
    length: float | None,
    target: Path | None,
    as_json: bool,
    **section: float | None,
) -> None:
    """The length of a bar, clamped at one end with the sensor at the other, for a resonance; or its resonance."""
    if (frequency is None) == (length is None):
        raise CalibrationError("found neither or both of --frequency and --length, expected one of them")
    beam, depth = _beam(material, section)
    warnings, tip = [] if tip is not None else [NO_TIP], tip or 0.0
    if length is None:
        length = length_for(beam, frequency or math.nan, tip)
        if math.isnan(length):
            raise CalibrationError(
                f"no bar of this section from 1 mm to 5 m rings at {frequency:g} Hz: take another one"
            )
    elif length <= 0:
        raise CalibrationError(f"found a length of {length:g} m, expected one above 0")
    first, second = frequencies(beam, length, tip)
    weight = beam.mass * length
    document = {
        "length_m": length, "f_res_hz": first, "second_hz": second, "bar_kg": weight, "tip_kg": tip,
        "stiffness_n_m": 3 * beam.stiffness / length**3, "least_rate_hz": LEAST_RATE * first,
    }  # fmt: skip
    words = [
        f"length  {length * 1e3:.1f} mm, free of the clamp",
        f"rings   at {first:.1f} Hz, and at {second:.0f} Hz in its second mode",
        f"weighs  {weight * 1e3:.1f} g, and {tip * 1e3:.1f} g at its end",
        f"sensor  at least {LEAST_RATE * first:.0f} samples a second, to measure the size of the play",
        f"clamp   {CLAMP}",
    ]
    values = {"f_res_hz": round(first, 1), "zeta": 0.012, "length_m": round(length, 4)}
    lines = lines_of(values, "oscillator of the [[accelerometer]]; calibrate tap measures the first two", "oscillator")
    report(document, words, [*warnings, *_warnings(length, depth)], lines, target, as_json)


def _beam(material: str, section: Mapping[str, float | None]) -> tuple[Beam, float]:
    """The bar, and how deep it is where it bends [m]."""
    width, thickness, diameter = (section[key] for key in ("width", "thickness", "diameter"))
    given = {key for key, value in section.items() if value is not None}
    if any(value is not None and not 0 < value <= 1 for value in section.values()):
        raise CalibrationError("found a width, thickness or diameter that is not between 0 and 1 m, expected some mm")
    if given == {"width", "thickness"} and width is not None and thickness is not None:
        return rectangle(MATERIALS[material], width, thickness), thickness
    if given == {"diameter"} and diameter is not None:
        return rod(MATERIALS[material], diameter), diameter
    found = ", ".join(f"--{key}" for key in sorted(given)) or "none of them"
    raise CalibrationError(f"found {found}, expected --width and --thickness of a flat bar, or --diameter of a rod")


def _warnings(length: float, depth: float) -> Iterator[str]:
    if length < SLENDER * depth:
        ratio = f"only {length / depth:.1f} times as long as thick, expected {SLENDER:g} and more"
        yield f"the bar is {ratio}: it rings lower than this, take a thinner one"
