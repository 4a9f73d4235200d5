"""Metrics for Prometheus, over HTTP: every scrape reads the database, as any other program would.

Imported only where ``[metrics]`` asks for it.  Names are in docs/metrics.md; a dashboard is in examples/grafana.
"""

from __future__ import annotations

import logging
import resource
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Event, Thread

from lostmotion import __version__
from lostmotion.daemon.database import DAMAGED
from lostmotion.daemon.exposition import Family, text
from lostmotion.daemon.metrics_http import MetricsServer
from lostmotion.daemon.monitored_joint import Counts
from lostmotion.daemon.reader import Reader, ReaderError, open_readonly
from lostmotion.daemon.records import Health, ScoreRow
from lostmotion.daemon.sockets import host_and_port
from lostmotion.daemon.store import Store

__all__ = ["Exporter"]

log = logging.getLogger(__name__)

LAST: tuple[tuple[str, str, Callable[[ScoreRow], float]], ...] = (
    ("score", "Score of the last window", lambda row: row.score),
    ("level", "Level above which a score is an impact (eq. 9)", lambda row: row.level),
    ("play_radians", "Size of the play; NaN where it cannot be estimated", lambda row: row.play),
    ("play_low_radians", "Lower end of its 95 % interval", lambda row: row.play_low),
    ("play_high_radians", "Upper end of its 95 % interval", lambda row: row.play_high),
    ("last_window_timestamp_seconds", "When the last window began", lambda row: row.time.timestamp()),
    ("severity_radians", "Equivalent play of the last window; NaN where it is unknown", lambda row: row.severity),
    ("severity_low_radians", "Lower end of its 95 % interval, 0 where there may be none", lambda row: row.severity_low),
    ("severity_high_radians", "Upper end of its 95 % interval", lambda row: row.severity_high),
)
RETRY_S = 2.0
"""between two attempts to listen at an address that another program has, of 42 us of processor time each [s]"""
LOSSES = ("lost", "late", "broken", "silent", "overwritten")


class Exporter:
    """Answers ``GET /metrics`` at an address, in a thread of its own, until it is closed.

    counts: windows by joint, as the pipeline counts them.  An address that is in use is logged, and tried again.
    """

    def __init__(self, listen: str, store: Store, counts: Mapping[str, Counts]) -> None:
        address = host_and_port(listen)
        assert address is not None  # the configuration was checked
        self._listen, self._closed = listen, Event()
        self._open = partial(MetricsServer, *address, lambda: text(_all(store, counts)))
        self._server: MetricsServer | None = None
        self._thread: Thread | None = None
        try:
            self._serve()
        except OSError as error:
            log.error("metrics: cannot listen at %s (%s), expected a free address of this computer; trying again",
                      listen, error)  # fmt: skip
            self._thread = Thread(target=self._retry, name="metrics-retry", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Gives the address back."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
        if self._server is not None:
            self._server.close()

    def _serve(self) -> None:
        self._server = self._open()
        log.info("metrics: http://%s/metrics", self._listen)

    def _retry(self) -> None:
        while self._server is None and not self._closed.wait(RETRY_S):
            with suppress(OSError):  # told once
                self._serve()


def _all(store: Store, counts: Mapping[str, Counts]) -> Iterator[Family]:
    """All metrics; those of the database only while it can be read."""
    yield Family("lostmotion_store_waiting_rows", "gauge", "Rows not on the disk yet").add(store.waiting())
    yield Family("lostmotion_store_dropped_rows", "counter", "Rows dropped").add(store.dropped)
    yield Family("lostmotion_store_writable", "gauge", "0 while the disk refuses rows").add(not store.problem)
    yield from _windows(dict(counts))
    yield from _process()
    readable = 1.0
    try:
        with open_readonly(store.path) as reader:
            yield from [_info(reader), *_joints(reader), _alarms(reader), *_devices(reader), _sinks(reader)]
    except (ReaderError, *DAMAGED):
        readable = 0.0
    yield Family("lostmotion_database_readable", "gauge", "Whether the database can be read").add(readable)


def _process() -> Iterator[Family]:
    """Under the names that Prometheus' own clients give them, from what of /proc a hardened service sees."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    memory = pages * resource.getpagesize()
    yield Family("process_resident_memory_bytes", "gauge", "Resident memory").add(memory)
    yield Family("process_cpu_seconds", "counter", "Processor time").add(time.process_time())


def _info(reader: Reader) -> Family:
    about = Family("lostmotion", "info", "The program and its robot", ("version", "robot"))
    return about.add(1.0, __version__, reader.robot())


def _windows(counts: Mapping[str, Counts]) -> Iterator[Family]:
    triggered = Family("lostmotion_windows_triggered", "counter", "Reversals seen", ("joint",))
    scored = Family("lostmotion_windows_scored", "counter", "Windows scored", ("joint",))
    lost = Family("lostmotion_windows_lost", "counter", "Windows lost, by reason", ("joint", "reason"))
    for joint, count in counts.items():
        triggered.add(count.triggered, joint)
        scored.add(count.scored, joint)
        for reason, number in dict(count.lost).items():
            lost.add(number, joint, reason)
    yield from (triggered, scored, lost)


def _joints(reader: Reader) -> Iterator[Family]:
    health = Family("lostmotion_joint_health", "gauge", "1 for the joint's health", ("joint", "health"))
    last = [(Family(f"lostmotion_joint_{name}", "gauge", words, ("joint",)), of) for name, words, of in LAST]
    for joint in reader.joints():
        for state in Health:
            health.add(joint.health is state, joint.name, state.value)
        if window := reader.last_window(joint.name):
            for family, of in last:
                family.add(of(window), joint.name)
    yield from (health, *(family for family, _ in last))


def _alarms(reader: Reader) -> Family:
    labels = ("joint", "cause", "severity", "state")
    family = Family("lostmotion_alarm", "gauge", "1 for each active alarm", labels)
    for alarm in reader.active_alarms():
        family.add(1.0, alarm.joint, alarm.cause.value, alarm.severity.value, alarm.state.value)
    return family


def _devices(reader: Reader) -> Iterator[Family]:
    reading = Family("lostmotion_device_reading", "gauge", "1 while samples arrive", ("device",))
    samples = Family("lostmotion_device_samples", "counter", "Samples since the start", ("device",))
    losses = Family("lostmotion_device_losses", "counter", "Samples lost, by kind", ("device", "kind"))
    for device in reader.devices():
        reading.add(device.state == "reading", device.name)
        samples.add(device.samples, device.name)
        for kind in LOSSES:
            losses.add(getattr(device, kind), device.name, kind)
    yield from (reading, samples, losses)


def _sinks(reader: Reader) -> Family:
    """One that does not tell its state has no sample."""
    family = Family("lostmotion_sink_up", "gauge", "1 while the sink reaches what is behind it", ("sink",))
    for sink in reader.sinks():
        if sink.is_up is not None:
            family.add(sink.is_up, sink.name)
    return family
