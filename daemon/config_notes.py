"""Remarks on a valid configuration: what it cannot measure, and which sockets others can reach.  No I/O."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from lostmotion.daemon.sockets import page_refusal, sockets
from lostmotion.detector.limits import poll_limit, rate_limit, window_limit
from lostmotion.drivers.base import BITS_PER_BYTE, JointOptions

if TYPE_CHECKING:
    from lostmotion.daemon.config import Config
    from lostmotion.drivers.base import AccelerometerOptions

__all__ = ["notes"]


def notes(config: Config) -> tuple[str, ...]:
    """One line each, none twice."""
    found = [note for sensor in config.accelerometers for note in _of_sensor(config, sensor)]
    found += [note for joint in config.joints for note in _of_joint(config, joint.name)]
    found += _of_lines(config)
    found += [
        f"{socket.of} listens at {socket.address}: open to {socket.reach}; there is no password"
        for socket in sockets(config)
        if socket.plain
    ]
    found += [
        f"lostmotion web refuses this: {refusal}" for refusal in [page_refusal(config.web, config.metrics)] if refusal
    ]
    return tuple(dict.fromkeys(found))


def _of_sensor(config: Config, sensor: AccelerometerOptions) -> Iterator[str]:
    """What cannot be measured with its rate, its bar and the lever arms of its joints."""
    own = [joint for joint in config.joints if joint.accelerometer == sensor.name]
    is_shared = sum(sensor.name in config.levers(joint) for joint in config.joints) > 1
    sizes = ["the size of the play"] * any(config.settings(joint.name).play_size for joint in own)
    what = " and ".join([*sizes, *["which joint has it" if sizes else "which joint has the play"] * is_shared])
    limits = [rate_limit(sensor.oscillator.f_res_hz, sensor.rate_hz, what)] if what else []
    limits += [window_limit(config.settings(joint.name), sensor.rate_hz) for joint in own]
    without = [joint.name for joint in own if sensor.name not in joint.levers_m]
    if is_shared and len(without) > 1:
        limits.append(
            f"which of the joints {', '.join(without)} has play, and its size, may be wrong: found no levers_m "
            f"of these, so that all are taken to be {sensor.oscillator.length_m:g} m away; expected levers_m of each"
        )
    yield from (f"accelerometer {sensor.name!r}: {limit}" for limit in limits if limit)


def _of_lines(config: Config) -> Iterator[str]:
    """Serial lines that are too slow for what is asked of them."""
    needed: dict[tuple[str, int], float] = {}
    items: tuple[JointOptions | AccelerometerOptions, ...] = (*config.joints, *config.accelerometers)
    for item in items:
        if size := item.line_bytes():
            rate_hz = item.poll_hz if isinstance(item, JointOptions) else item.rate_hz
            line = item.port, getattr(item, "baudrate", 0)
            needed[line] = needed.get(line, 0.0) + size * rate_hz
    for (port, baudrate), bytes_s in needed.items():
        if bytes_s * BITS_PER_BYTE > baudrate:
            yield (
                f"port {port}: found {baudrate} baud, which carry {baudrate / BITS_PER_BYTE:.0f} bytes a second, "
                f"expected at least {bytes_s * BITS_PER_BYTE:.0f} baud for the configured rates (the USB port of a "
                "microcontroller itself carries more, whatever its baud rate)"
            )


def _of_joint(config: Config, name: str) -> Iterator[str]:
    """What cannot be measured with its commands; whether eq. 8's norm band is cut off."""
    joint, settings = config.joint(name), config.settings(name)
    nyquist = config.accelerometer(joint.accelerometer).rate_hz / 2
    if limit := poll_limit(joint.poll_hz):
        yield f"joint {name!r}: {limit}"
    if settings.statistic == "band" and settings.f_norm_hz + settings.f_norm_width_hz / 2 > nyquist:
        yield (
            f"joint {name!r}: the norm's band reaches beyond {nyquist:g} Hz, half of rate_hz of accelerometer "
            f"{joint.accelerometer!r}, and is cut off there"
        )
