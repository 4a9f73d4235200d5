"""The checks of servos and accelerometers in one short measurement, for ``doctor``."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from lostmotion.daemon.commands.checks import Check, within
from lostmotion.daemon.commands.devices import Device, Devices, Event
from lostmotion.daemon.config import Config
from lostmotion.drivers.base import AccelBlock, FloatArray, Identity, ServoReading

__all__ = ["check_devices", "white_noise"]

PASS_S = 3.0
"""Robot time of the measurement [s]."""
RATE_TOLERANCE = 0.05
POLL_TOLERANCE = 0.1
MOST_LOST = 0.01
"""Share of samples or polls."""
LEAST_SAMPLES = 3
"""Fewer have no rate and no noise."""
UNLIKE = "another device, model, rate or id than configured, or it has no power"
NOISE_MS2 = (1e-4, 2.0)
"""Below: a sensor that is stuck.  Above: it hides a ring-down, whose first swing is a few m/s²."""
NOISE_BLOCK, QUIET = 128, 0.1


@dataclass(slots=True)
class DeviceData:
    """All data of one device."""

    device: Device
    identities: list[Identity] = field(default_factory=list)
    times: dict[str, list[float]] = field(default_factory=dict)
    good: Counter[str] = field(default_factory=Counter)
    accel: list[FloatArray] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(("lost", "late", "broken", "silent"), 0))
    error: str = ""

    def add(self, event: Event) -> None:
        """Keeps what the event brings."""
        self.identities += event.identities
        self.error = str(event.error or self.error)
        data = event.data
        if isinstance(data, ServoReading):
            for sample in data.samples:
                self.times.setdefault(sample.joint, []).append(sample.time)
                self.good[sample.joint] += 1
            self.counts["lost"] += data.lost
            self.counts["broken"] += data.broken
            self.counts["silent"] += len(data.silent)
        elif isinstance(data, AccelBlock):
            self.times.setdefault(self.device.members[0], []).extend(data.time.tolist())
            self.accel.append(data.accel)
            self.good[self.device.members[0]] += int(np.isfinite(data.accel).sum())
            for kind in ("lost", "late", "broken"):
                self.counts[kind] += getattr(data, kind)


def check_devices(config: Config) -> list[Check]:
    """Measures for PASS_S seconds of robot time with all devices at once, as the service does."""
    devices = Devices(config)
    by_device = {device.name: DeviceData(device) for device in devices.all}
    with devices:
        for event in chain(devices.identities(), devices.events(PASS_S)):
            by_device[event.device.name].add(event)
    return [check for one in by_device.values() for check in _checks(config, one)]


def _checks(config: Config, data: DeviceData) -> Iterator[Check]:
    name = data.device.name
    if data.error:
        yield Check(name, "port", "failed", "", "open and answering", False, data.error)
    for who in data.identities:
        yield Check(who.name, "identity", who.found, "", who.expected, who.ok, "" if who.ok else UNLIKE)
    if not data.identities:
        return
    is_bus = data.device.members[0] in {joint.name for joint in config.joints} and not data.accel
    causes = {who.name: UNLIKE for who in data.identities if not who.ok}
    for member in data.device.members:
        times = np.array(data.times.get(member, []))
        cause = causes.get(member, "it identified itself, then sent no data: a loose cable, or no power?")
        yield within(member, "samples", data.good[member], "", LEAST_SAMPLES, None, cause)
        if data.good[member] >= LEAST_SAMPLES:
            yield from _servo(config, member, times) if is_bus else _sensor(config, member, times, data)
    if data.good.total():
        yield _losses(data)


def _servo(config: Config, joint: str, times: FloatArray) -> Iterator[Check]:
    wanted = config.joint(joint).poll_hz
    cause = "a slow bus: more servos than it can serve at this baud rate, or an FTDI latency timer above 1 ms"
    low, high = (1 - POLL_TOLERANCE) * wanted, (1 + POLL_TOLERANCE) * wanted
    yield within(joint, "poll rate", _rate(times), "Hz", low, high, cause)


def _sensor(config: Config, name: str, times: FloatArray, data: DeviceData) -> Iterator[Check]:
    options, rate = config.accelerometer(name), _rate(times)
    low, high = (1 - RATE_TOLERANCE) * options.rate_hz, (1 + RATE_TOLERANCE) * options.rate_hz
    yield within(name, "sample rate", rate, "Hz", low, high, "the sensor is set to another rate than rate_hz")
    settings = [config.settings(joint.name) for joint in config.joints if joint.accelerometer == name]
    top = max((s.f_res_hz + s.f_width_hz / 2 for s in settings), default=options.oscillator.f_res_hz)
    cause = "the oscillator is too fast for this sensor: lengthen the bar or load its end, or take a faster sensor"
    yield within(name, "upper end of the oscillator's band", top, "Hz", None, rate / 2, cause)
    noise = white_noise(np.concatenate(data.accel)) if data.accel else np.nan
    cause = "no signal: is the sensor alive?" if not noise >= NOISE_MS2[0] else "a loose sensor, or a wrong range"
    yield within(name, "noise", noise, "m/s²", *NOISE_MS2, cause)


def white_noise(accel: FloatArray) -> float:
    """Standard deviation of white noise [m/s²] under a motion and a ringing bar, of accel, shape (N,); NaN for too few.

    From the median over frequency of a Hann periodogram (ln 2 of the mean, for white noise), to which lines and a slow
    motion are strangers, in the quietest tenth of all blocks of 128: an impact is broad.
    """
    accel = accel[np.isfinite(accel)]
    blocks = accel[: accel.size // NOISE_BLOCK * NOISE_BLOCK].reshape(-1, NOISE_BLOCK)
    window = np.hanning(NOISE_BLOCK)
    spectra = np.abs(np.fft.rfft((blocks - blocks.mean(axis=1, keepdims=True)) * window)) ** 2 / np.sum(window**2)
    return float(np.sqrt(np.quantile(np.median(spectra, axis=1), QUIET) / math.log(2))) if blocks.size else math.nan


def _losses(data: DeviceData) -> Check:
    samples = sum(len(times) for times in data.times.values())
    bad = sum(data.counts.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in data.counts.items() if count) or "none"
    ok = samples > 0 and bad <= MOST_LOST * samples
    cause = "" if ok else "a bad cable, a loaded machine, a servo without power, or too low a baud rate"
    allowed = f"at most {MOST_LOST:.0%}"
    return Check(data.device.name, "bad samples", f"{counts}; {samples} read", "", allowed, ok, cause)


def _rate(times: FloatArray) -> float:
    """Samples a second over the whole pass (a hole counts, unlike in a median), NaN for too few."""
    return float((times.size - 1) / (times[-1] - times[0])) if times.size > 2 and times[-1] > times[0] else np.nan
