"""A physical parameter: its value, unit, bounds for a fit, and where the value comes from.  No physics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from lostmotion.model.errors import ModelError

__all__ = ["Domain", "Parameter"]


class Domain(Enum):
    """Which values physics allows, whatever the bounds of a fit are."""

    ANY = "any number"
    POSITIVE = "more than 0"
    NOT_NEGATIVE = "0 or more"
    SHARE = "more than 0 and less than 1"
    RATE = "more than -1 (a clock does not run backwards)"
    WHOLE = "a whole number of at least 1"
    ODD = "an odd whole number from 1 to 101"

    @property
    def is_whole(self) -> bool:
        """Whether only whole numbers are possible, between which there are no small steps."""
        return self in (Domain.WHOLE, Domain.ODD)

    def allows(self, value: float) -> bool:
        """Whether a finite value lies in the domain."""
        match self:
            case Domain.ANY:
                return True
            case Domain.POSITIVE:
                return value > 0
            case Domain.NOT_NEGATIVE:
                return value >= 0
            case Domain.SHARE:
                return 0 < value < 1
            case Domain.RATE:
                return value > -1
            case Domain.WHOLE:
                return value.is_integer() and value >= 1
            case Domain.ODD:
                return value.is_integer() and 1 <= value <= 101 and value % 2 == 1


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a model, in SI units; the unit "1" is none.

    low and high bound a fit; fixed: a fit leaves it alone; source: where the value comes from ("guess: …" where it is
    one); meaning: what it is; domain: what physics allows.  Raises ModelError for a value that is not finite or lies
    outside the bounds or the domain, and for bounds that are swapped.
    """

    value: float
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    fixed: bool = False
    source: str = ""
    meaning: str = ""
    domain: Domain = Domain.ANY

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _number(self.value))
        object.__setattr__(self, "unit", "" if self.unit == "1" else self.unit)
        if not math.isfinite(self.value) or not self.domain.allows(self.value):
            given = f"{self.value:g} {self.unit}".rstrip()
            expected = self.domain.value if math.isfinite(self.value) else "a finite number"
            raise ModelError(f"{given} is not possible; it must be {expected}")
        if self.low > self.high:
            raise ModelError(f"low = {self.low:g} is more than high = {self.high:g}; are the bounds swapped?")
        if not self.low <= self.value <= self.high:
            raise ModelError(
                f"{self.value:g} lies outside its own bounds {self.low:g} to {self.high:g} {self.unit}".rstrip()
            )

    def check_unit(self, unit: str) -> None:
        """Raises ModelError unless it is the unit of this parameter ("1" where it has none), or "" for none given."""
        if unit and unit != (self.unit or "1"):
            raise ModelError(
                f"the unit is {unit!r}, expected {repr(self.unit) if self.unit else 'none'}; values are in SI units"
            )

    def clipped(self, value: float) -> float:
        """The value within the bounds."""
        return min(max(value, self.low), self.high)

    def updated(self, given: float | Parameter) -> Parameter:
        """This parameter with a new value (bounds widen to hold it), or with all that a given Parameter states.

        Raises ModelError when the given Parameter has another unit.
        """
        if not isinstance(given, Parameter):
            value = _number(given)
            low, high = _least(self.low, value), -_least(-self.high, -value)
            return Parameter(value, self.unit, low, high, self.fixed, self.source, self.meaning, self.domain)
        self.check_unit(given.unit)
        low = given.low if given.low > -math.inf else _least(self.low, given.value)
        high = given.high if given.high < math.inf else -_least(-self.high, -given.value)
        source, meaning = given.source or self.source, given.meaning or self.meaning
        return replace(given, unit=self.unit, low=low, high=high, source=source, meaning=meaning, domain=self.domain)


def _number(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{value!r} is not a number") from error


def _least(bound: float, value: float) -> float:
    return value if value < bound else bound  # NaN keeps the bound; the value itself is refused elsewhere
