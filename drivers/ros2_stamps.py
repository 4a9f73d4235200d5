"""Whose clock the messages of a topic are stamped by, and whether that clock is fit to be followed.  Pure."""

from __future__ import annotations

import math
from enum import Enum

from lostmotion.drivers.codec.rmw_zenoh import sent
from lostmotion.drivers.codec.ros2_messages import SECOND_NS

__all__ = ["Source", "clock_fault", "stamped"]

SIMULATED_BEFORE_S = 1e8
"""a header's stamp before 1973 is no time of day: a simulation's begins at 0"""
RATE_OFF, LATE_S = 0.2, 0.1
"""how much faster or slower a clock may seem to run than the host's, and how much later a message may come on a busy
host [s]: a simulation at half or twice real time is seen within 0.8 s, a smaller drift is followed"""


class Source(Enum):
    """Where the time of a message comes from."""

    HEADER = "header's stamps"
    SIMULATION = "simulated time"
    PUBLISHER = "the publisher's time, as the header's stamps are 0"
    ARRIVAL = "the time of arrival, as the header's stamps are 0"


def stamped(header_ns: int, attached: bytes) -> tuple[float, Source]:
    """The time of a message [s] and where it comes from; NaN where only its arrival is known."""
    if header_ns:
        seconds = header_ns / SECOND_NS
        return seconds, Source.HEADER if seconds >= SIMULATED_BEFORE_S else Source.SIMULATION
    info = sent(attached)
    return (info.time_ns / SECOND_NS, Source.PUBLISHER) if info else (math.nan, Source.ARRIVAL)


def clock_fault(span_s: float, passed_s: float) -> str:
    """What is wrong with stamps that went on ``span_s`` while ``passed_s`` went by; "" for nothing."""
    if abs(span_s - passed_s) <= RATE_OFF * passed_s + LATE_S:
        return ""
    pace = f"stamps that go on {span_s / passed_s:.2g} s in a second"
    return (
        f"{pace}; likely cause: simulated time (use_sim_time) at another speed than real time, or a clock that was set"
    )
