"""The running parts of a configuration: clock, pollers, rings, pipeline.  Nothing is stored or published here."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Iterator

from lostmotion.daemon.attributor import Attributor, SharedSensor
from lostmotion.daemon.capture import Capture
from lostmotion.daemon.config import Config
from lostmotion.daemon.losses import Losses
from lostmotion.daemon.monitored_joint import JointPlan
from lostmotion.daemon.pipeline import Pipeline, Scored
from lostmotion.daemon.poller import AccelPoller, BusPoller, DeviceState, Inbox, Poller
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.sensorcheck import SensorCheck
from lostmotion.drivers.base import AccelerometerOptions, JointOptions, ServoSample

__all__ = ["Robot"]

RING_S = 20.0
"""how much acceleration is kept of hardware [s]"""
VIRTUAL_RING_S = 60.0
DEAD_S = 3.0
"""a device that reads nothing for so long is dead [s]"""
BAD = (DeviceState.RETRYING, DeviceState.WRONG)


class Robot:
    """All devices of a configuration.  ``pollers`` wait for someone to give each a thread."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.stop = threading.Event()
        self.inbox = Inbox()
        self.clock = config.make_clock()
        self.rings = {sensor.name: self._ring(sensor) for sensor in config.accelerometers}
        self.pollers: list[Poller] = [*self._buses(), *self._sensors()]
        plans = [_plan(config, joint) for joint in config.joints]
        self.pipeline = Pipeline(plans, self.rings, config.is_virtual, map(Attributor, _shared(config)))
        self._by_member = {member: poller for poller in self.pollers for member in poller.members}
        self._losses = {member: Losses() for member in self._by_member}
        self._checks = {sensor.name: self._check(sensor.name) for sensor in config.accelerometers}
        self._check_of = {joint.name: self._checks[joint.accelerometer] for joint in config.joints}
        self._capture: Capture | None = None
        self._started = time.monotonic()

    def continue_from(self, earlier: Robot) -> None:
        """Keeps what another robot on the same clock knows of which joint has the play, where neither the joints nor
        their accelerometers have changed."""
        if self.config.is_virtual or earlier.config.is_virtual:
            return
        for attributor in self.pipeline.attributors:
            of = attributor.joints, attributor.accelerometers
            for other in earlier.pipeline.attributors:
                if (other.joints, other.accelerometers) == of and self._have_stayed(earlier.config, *of):
                    attributor.continue_from(other)

    def _have_stayed(self, config: Config, joints: Iterable[str], sensors: Iterable[str]) -> bool:
        """Whether these are the same in another configuration."""
        own = self.config
        return all(own.joint(name) == config.joint(name) for name in joints) and all(
            own.accelerometer(name) == config.accelerometer(name) and _noise(own, name) == _noise(config, name)
            for name in sensors
        )

    def capture(self, capture: Capture | None) -> None:
        """From now on a joint and its accelerometer are recorded, and no other; None: nothing is."""
        if self._capture is not None:
            self._capture.end()
        self._capture = capture
        recorded = capture and self.config.joint(capture.joint).accelerometer
        for name, ring in self.rings.items():
            ring.copy = capture.add if capture and name == recorded else None

    def limits(self, joint: JointOptions) -> dict[str, float]:
        """The resolution of a joint's command [rad] and the range of its accelerometer [m/s²], once they are known."""
        bus = self._by_member[joint.name]
        resolution = bus.resolution_rad if isinstance(bus, BusPoller) else math.nan
        return {"resolution_rad": resolution, "range_ms2": self.rings[joint.accelerometer].range_ms2}

    def step(self) -> list[Scored]:
        """Takes what came in since the last call; the windows that are done."""
        if self._capture is not None and self._capture.is_over:
            self.capture(None)
        self._listen()
        now = self.clock.now()
        done = self.pipeline.step(now)
        for scored in done:
            self._check_of[scored.score.joint].scored(scored.window, scored.score)
        for check in self._checks.values():
            check.look(now)
        return done

    def compare(self) -> None:
        """Compares sensors and motion for the last time: a recording is over."""
        for check in self._checks.values():
            check.look(self.clock.now(), is_last=True)

    def _listen(self) -> None:
        """Passes on the samples of the joints, those of one bus together."""
        ended = [poller for poller in self.pollers if poller.status.state is DeviceState.ENDED]
        by_resolution: dict[float, list[ServoSample]] = {}
        while self.inbox.servo:
            resolution_rad, samples = self.inbox.servo.popleft()
            by_resolution.setdefault(resolution_rad, []).extend(samples)
        for resolution_rad, together in by_resolution.items():
            if self._capture is not None:
                _record(self._capture, together)
            self.pipeline.servo(together, resolution_rad)
            for check in self._checks.values():
                check.moved(together)
        for poller in ended:
            if isinstance(poller, BusPoller):
                for joint in poller.members:
                    self.pipeline.servo_ended(joint)

    @property
    def is_open(self) -> bool:
        """Whether any device has been opened, or has failed to."""
        return any(poller.status.state is not DeviceState.OPENING for poller in self.pollers)

    @property
    def finished(self) -> bool:
        """Whether every device has come to its end and all its data has been used."""
        ended = all(poller.status.state is DeviceState.ENDED for poller in self.pollers)
        return ended and not self.inbox.servo and not self.pipeline.open_windows

    def fault(self, joint: JointOptions) -> str | None:
        """What keeps a joint from being measured, "" for nothing; None while its devices have not shown it yet."""
        members = (joint.name, joint.accelerometer)
        faults, losses = [self._fault(member) for member in members], [self._lost(member) for member in members]
        if None in faults and not any(faults):
            return None
        if any(faults):  # bad windows follow from a bad device
            return "; ".join(dict.fromkeys(fault for fault in faults if fault))
        lost = "; ".join(filter(None, losses))
        shown = self._check_of[joint.name].fault(joint.name, is_lossy=bool(lost))
        return "; ".join(filter(None, (lost, shown)))

    def compared(self, joint: JointOptions) -> tuple[str, int | None]:
        """Why a joint whose windows are sound may all the same not be measured, "" for no reason; how often its sensor
        was compared with its motion, None when it is known to measure it."""
        check = self._check_of[joint.name]
        return check.doubt(joint.name), check.comparisons(joint.name)

    def _fault(self, member: str) -> str | None:
        poller = self._by_member[member]
        status = poller.status
        if status.state is not DeviceState.RETRYING and member in status.faults:
            return status.faults[member]
        if status.state in BAD:
            return poller.named(status.reason)
        if self.config.is_virtual or status.state is DeviceState.ENDED:
            return ""
        last_seen, now = status.last_seen.get(member), time.monotonic()
        if now - (last_seen or self._started) > DEAD_S and status.state is DeviceState.READING:
            return f"{member}: no data for more than {DEAD_S:g} s from {poller.name}"
        return None if last_seen is None else ""

    def _lost(self, member: str) -> str:
        """Which share of its samples is lost, "" while that is little."""
        poller, losses, now = self._by_member[member], self._losses[member], time.monotonic()
        if poller.status.state is not DeviceState.READING or self.config.is_virtual:
            losses.clear()
            return ""
        if member not in poller.status.last_seen:
            return ""
        lost = losses.fault(now, *poller.supply(member, now))
        return lost and f"{member}: {lost}: a slow or noisy line, a loose plug, or a busy computer"

    @property
    def samples(self) -> int:
        """All that the devices have delivered."""
        return sum(poller.status.samples for poller in self.pollers)

    def hung(self, patience_s: float) -> list[str]:
        """The devices whose poller has shown no sign of life for so long; waiting for a device is life."""
        now = time.monotonic()
        return [poller.name for poller in self.pollers if now - poller.pulse > patience_s]

    def _ring(self, sensor: AccelerometerOptions) -> Ring:
        seconds = VIRTUAL_RING_S if self.config.is_virtual else RING_S
        return Ring(max(int(seconds * sensor.rate_hz), 1024), self.inbox.waker)

    def _check(self, sensor: str) -> SensorCheck:
        arms = {joint.name: self.config.levers(joint) for joint in self.config.joints}
        return SensorCheck(
            sensor, self.rings[sensor], {joint: of[sensor] for joint, of in arms.items() if sensor in of}
        )

    def _buses(self) -> Iterator[BusPoller]:
        for joints in self.config.buses():
            bus = self.config.make_bus(joints, self.clock)
            name, names = f"{joints[0].driver} {joints[0].port}".strip(), tuple(joint.name for joint in joints)
            yield BusPoller(name, names, bus, self.stop, self.inbox, self.config.is_virtual)

    def _sensors(self) -> Iterator[AccelPoller]:
        for options in self.config.accelerometers:
            sensor = self.config.make_accelerometer(options, self.clock)
            ring, period = self.rings[options.name], 1 / options.rate_hz
            yield AccelPoller(options.name, sensor, self.stop, ring, period, self.config.is_virtual, self.clock.cycle_s)


def _noise(config: Config, sensor: str) -> tuple[float | None, tuple[float, ...]]:
    """The noise of an accelerometer, where it is calibrated."""
    settings = config.bar_settings(config.accelerometer(sensor))
    return settings.noise_ms2, settings.noise_colour


def _record(capture: Capture, samples: list[ServoSample]) -> None:
    of_joint = [sample for sample in samples if sample.joint == capture.joint]
    if of_joint:
        capture.add(of_joint)


def _plan(config: Config, joint: JointOptions) -> JointPlan:
    rate_hz = config.accelerometer(joint.accelerometer).rate_hz
    return JointPlan(joint.name, joint.accelerometer, rate_hz, joint.poll_hz, config.settings(joint.name))


def _shared(config: Config) -> list[list[SharedSensor]]:
    """The accelerometers that several joints move, those together that have a joint in common."""
    groups: list[list[SharedSensor]] = []
    for sensor in config.accelerometers:
        levers = {
            joint.name: arms[sensor.name] for joint in config.joints if sensor.name in (arms := config.levers(joint))
        }
        if not levers:
            continue
        shared = SharedSensor(sensor.name, sensor.rate_hz, config.bar_settings(sensor), levers)
        linked = [group for group in groups if any(levers.keys() & other.levers.keys() for other in group)]
        groups = [group for group in groups if group not in linked] + [
            [*(one for group in linked for one in group), shared]
        ]
    return [group for group in groups if len({joint for one in group for joint in one.levers}) > 1]
