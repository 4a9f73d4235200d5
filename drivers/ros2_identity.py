"""The identities on topics of ROS 2: which joints and sensors publish there, at which rate and by which clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from statistics import median

from lostmotion.drivers.base import Identity
from lostmotion.drivers.codec.cdr import CdrError
from lostmotion.drivers.codec.rmw_zenoh import Endpoint, sent
from lostmotion.drivers.codec.ros2_messages import DECODERS, IMU, JointStates, imu_acceleration
from lostmotion.drivers.ros2_session import Listener, Message
from lostmotion.drivers.ros2_stamps import Source, clock_fault, stamped
from lostmotion.drivers.sensor_rate import rate_identity

__all__ = ["REFERENCE", "Wanted", "decoded", "identify_all"]

SILENCE_S, LISTEN_S, DOUBT_S = 2.5, 0.8, 3.2
"""how long to wait for a first message, and then to listen; and in all where a clock seems to be wrong: a message
that a busy host held up looks like a slow clock, but the delay does not grow with the time and the clock's does"""
MOST_NAMES = 20
REFERENCE = ", commanded: the controller's reference"


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is expected of a joint or sensor of that name: a topic of one of these types; joint: its name there;
    is_controlled: whether a controller's reference is wanted; rate_hz: of a sensor."""

    name: str
    topic: str
    joint: str
    types: tuple[str, ...]
    is_controlled: bool = False
    rate_hz: float = 0.0


Received = list[tuple[float, Message]]
"""the messages of one topic, with the times at which they were found [s]"""


@dataclass(slots=True)
class _Sum:
    """What the messages of a topic come to."""

    stamps: list[tuple[float, float]] = field(default_factory=list)
    source: Source = Source.ARRIVAL
    names: dict[str, set[bytes]] = field(default_factory=dict)
    senders: set[bytes] = field(default_factory=set)
    type: str = ""
    broken: str = ""
    has_reference: bool = False


def identify_all(listener: Listener, wanted: Sequence[Wanted], now: Callable[[], float]) -> list[Identity]:
    """Listens to all topics at once; an Identity for each that is wanted.  Raises PortError."""
    received: dict[str, Received] = {topic: [] for topic in listener.topics}
    for topic in received:
        listener.take(topic)
    start = now()
    _listen(listener, received, start, LISTEN_S, now)
    sums = [_sum(one, received[one.topic]) for one in wanted]
    if any(map(_clock_fault, sums)):
        _listen(listener, received, start, DOUBT_S, now)
        sums = [_sum(one, received[one.topic]) for one in wanted]
    listener.check()
    shown = listener.publishers()
    return [_identity(one, received[one.topic], total, shown) for one, total in zip(wanted, sums, strict=True)]


def _listen(
    listener: Listener, received: dict[str, Received], start: float, listen_s: float, now: Callable[[], float]
) -> None:
    """Listens until each topic has sent for ``listen_s``, or stayed silent."""

    def end(one: Received) -> float:
        return one[0][0] + listen_s if one else start + SILENCE_S

    while any(now() < end(one) for one in received.values()):
        time.sleep(0.01)
        for topic, messages in received.items():
            moment = now()
            messages += [(moment, message) for message in listener.take(topic)]


def _identity(wanted: Wanted, received: Received, total: _Sum, shown: Sequence[Endpoint]) -> Identity:
    what = f"joint {wanted.joint!r}" if wanted.joint else IMU
    expected = f"{what} on {wanted.topic}" + (f" at {wanted.rate_hz:g} Hz" if wanted.rate_hz else "")

    def wrong(found: str) -> Identity:
        return Identity(wanted.name, found, expected, False)

    if not received:
        return wrong(_nothing(wanted, shown))
    types = {message.type for _, message in received}
    if other := types - {*wanted.types}:
        return wrong(
            f"{', '.join(sorted(other))} on {wanted.topic}, which is none of {', '.join(wanted.types)};"
            " likely cause: another topic is meant"
        )
    if fault := _fault(wanted, total, shown):
        return wrong(fault)
    rate = _rate([stamp for _, stamp in total.stamps])
    if wanted.joint:
        found = f"{what} at {rate:.0f} Hz, {total.source.value}{_command(total)}"
        return Identity(wanted.name, found, expected, True)
    cause = "rate_hz is not what the sensor's node publishes"
    return rate_identity(wanted.name, what, rate, wanted.rate_hz, expected, cause, f", {total.source.value}")


def _command(total: _Sum) -> str:
    if total.has_reference:
        return REFERENCE
    return ", commanded: the measured position, as no controller's reference is given (the key reference)"


def _nothing(wanted: Wanted, shown: Sequence[Endpoint]) -> str:
    """Why a topic is silent, by the publishers there are."""
    found = f"no message on {wanted.topic} in {SILENCE_S:g} s"
    if here := sorted({one.node for one in shown if one.topic == wanted.topic}):
        cause = "likely cause: its hardware or controller is not active"
        return f"{found}, though {', '.join(here)} would publish it; {cause}"
    fitting = sorted({one.topic for one in shown if one.type in wanted.types})
    there = f"; there are {', '.join(fitting[:MOST_NAMES])}" if fitting else ", and no topic of a fitting type"
    return f"{found}{there}; likely cause: another name, namespace or domain_id, or its node does not run"


def _fault(wanted: Wanted, total: _Sum, shown: Sequence[Endpoint]) -> str:
    """What is wrong with messages of the right type; "" for nothing."""
    if total.broken:
        return f"messages on {wanted.topic} that cannot be read: {total.broken}; likely cause: another type is meant"
    if wanted.joint and wanted.joint not in total.names:
        names = ", ".join(sorted(total.names)[:MOST_NAMES]) or "none"
        return f"no joint {wanted.joint!r} on {wanted.topic}; there are {names}"
    senders = total.names[wanted.joint] if wanted.joint else total.senders
    if len(senders) > 1:
        nodes = ", ".join(sorted({one.node for one in shown if one.topic == wanted.topic and one.node}))
        return (
            f"{len(senders)} publishers of {f'joint {wanted.joint!r}' if wanted.joint else 'one Imu'} on {wanted.topic}"
            f" ({nodes}); expected one, as their values cannot be separated; likely cause: a node was started twice"
        )
    if wanted.is_controlled and not total.has_reference:
        return f"no reference of joint {wanted.joint!r} on {wanted.topic}; likely cause: not the state of a controller"
    return _clock_fault(total)


def _clock_fault(total: _Sum) -> str:
    if total.source is Source.ARRIVAL or len(total.stamps) < 2:
        return ""
    half = len(total.stamps) // 2
    pairs = list(zip(total.stamps, total.stamps[half:], strict=False))
    passed_s = median(later[0] - one[0] for one, later in pairs)
    # Medians: the first message may be an old one that its publisher keeps for those who come late.
    return clock_fault(median(later[1] - one[1] for one, later in pairs), passed_s) if passed_s > 0 else ""


def _sum(wanted: Wanted, received: Received) -> _Sum:
    total = _Sum()
    for moment, message in received:
        try:
            stamp_ns, names, has_reference = _contents(wanted, message)
        except CdrError as error:
            total.broken = str(error)
            continue
        seconds, total.source = stamped(stamp_ns, message.attached)
        if not wanted.joint or wanted.joint in names:
            total.stamps.append((moment, seconds if total.source is not Source.ARRIVAL else moment))
            total.has_reference = has_reference
        who = sent(message.attached)
        for name in names:
            total.names.setdefault(name, set()).update({who.gid} if who else ())
        total.senders.update({who.gid} if who else ())
    return total


def _contents(wanted: Wanted, message: Message) -> tuple[int, Iterable[str], bool]:
    """The stamp of a message, the joints in it, and whether it has their commands."""
    if not wanted.joint:
        return imu_acceleration(message.data)[0], (), False
    states = decoded(message)
    return states.stamp_ns, states.names, bool(states.reference)


def decoded(message: Message) -> JointStates:
    """The joints of a message.  Raises CdrError, also for a type without joints."""
    if message.type not in DECODERS:
        raise CdrError(f"found {message.type}, expected {', '.join(DECODERS)}")
    return DECODERS[message.type](message.data)


def _rate(times: Sequence[float]) -> float:
    span = times[-1] - times[0] if len(times) > 1 else 0.0
    return (len(times) - 1) / span if span > 0 else 0.0
