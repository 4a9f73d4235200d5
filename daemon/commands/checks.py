"""One check of ``doctor``: a value, its allowed range, and the likely cause when it is outside."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Check", "within"]


@dataclass(frozen=True, slots=True)
class Check:
    """subject: a joint, a sensor, a port, or "system"; check: what was looked at; value, with its unit; allowed: in
    words; cause: the likely one, "" when ok."""

    subject: str
    check: str
    value: float | str
    unit: str
    allowed: str
    ok: bool
    cause: str = ""


def within(
    subject: str, check: str, value: float, unit: str, low: float | None, high: float | None, cause: str
) -> Check:
    """A number that has to lie in low..high; None: no bound on that side.  NaN is never good."""
    ok = (low is None or value >= low) and (high is None or value <= high) and value == value
    ends = [f"{end:.4g}" if end is not None else "" for end in (low, high)]
    allowed = " to ".join(ends) if all(ends) else f"at least {ends[0]}" if ends[0] else f"at most {ends[1]}"
    return Check(subject, check, value, unit, allowed, ok, "" if ok else cause)
