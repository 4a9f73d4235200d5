"""What Prometheus may ask for, over HTTP: every scrape reads the database, as any other program would.

Imported only where ``[metrics]`` asks for it.  Names are in docs/metrics.md; a dashboard is in examples/grafana.
"""

from __future__ import annotations

import logging
import resource
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from prometheus_client import CollectorRegistry, Metric
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.registry import Collector

from lostmotion import __version__
from lostmotion.daemon.database import DAMAGED
from lostmotion.daemon.metrics_http import MetricsServer
from lostmotion.daemon.pipeline import Counts
from lostmotion.daemon.reader import Reader, ReaderError, open_readonly
from lostmotion.daemon.records import Health, ScoreRow
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
)
SEVERITY: tuple[tuple[str, str, Callable[[ScoreRow], float]], ...] = (
    ("severity_rad", "Equivalent play of the last window; NaN where it is unknown", lambda row: row.severity),
    ("severity_low_rad", "Lower end of its 95 % interval, 0 where there may be none", lambda row: row.severity_low),
    ("severity_high_rad", "Upper end of its 95 % interval", lambda row: row.severity_high),
)
LOSSES = ("lost", "late", "broken", "silent", "overwritten")


class Exporter:
    """Answers ``GET /metrics`` at an address, in a thread of its own, until it is closed.

    counts: windows by joint, as the pipeline counts them.  An address that is taken is told in the log.
    """

    def __init__(self, listen: str, store: Store, counts: Mapping[str, Counts]) -> None:
        self._server: MetricsServer | None = None
        registry = CollectorRegistry()
        registry.register(_Collector(store, counts))
        host, _, port = listen.rpartition(":")
        try:
            self._server = MetricsServer(host.strip("[]"), int(port), registry)
            log.info("metrics: http://%s/metrics", listen)
        except OSError as error:
            log.error("metrics: found %s not to be had (%s), expected a free address of this computer", listen, error)

    def close(self) -> None:
        """Gives the address back."""
        if self._server is not None:
            self._server.close()


class _Collector(Collector):
    def __init__(self, store: Store, counts: Mapping[str, Counts]) -> None:
        self._store = store
        self._counts = counts

    def collect(self) -> Iterator[Metric]:
        """All metrics; those of the database only while it can be read."""
        yield GaugeMetricFamily("lostmotion_store_waiting_rows", "Rows not on the disk yet", self._store.waiting())
        yield CounterMetricFamily("lostmotion_store_dropped_rows", "Rows given up", self._store.dropped)
        yield GaugeMetricFamily("lostmotion_store_writable", "0 while the disk refuses rows", not self._store.problem)
        yield from _windows(dict(self._counts))
        yield from _process()
        readable = 1.0
        try:
            with open_readonly(self._store.path) as reader:
                yield from [_info(reader), *_joints(reader), _alarms(reader), *_devices(reader)]
        except (ReaderError, *DAMAGED):
            readable = 0.0
        yield GaugeMetricFamily("lostmotion_database_readable", "Whether the database can be read", readable)


def _process() -> Iterator[Metric]:
    """Under the names of the client's own collector, which needs more of /proc than a hardened service sees."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    memory = pages * resource.getpagesize()
    yield GaugeMetricFamily("process_resident_memory_bytes", "Resident memory", memory)
    yield CounterMetricFamily("process_cpu_seconds", "Processor time", time.process_time())


def _info(reader: Reader) -> Metric:
    about = {"version": __version__, "robot": reader.robot()}
    return InfoMetricFamily("lostmotion", "The program and its robot", about)


def _windows(counts: Mapping[str, Counts]) -> Iterator[Metric]:
    triggered = CounterMetricFamily("lostmotion_windows_triggered", "Reversals seen", labels=["joint"])
    scored = CounterMetricFamily("lostmotion_windows_scored", "Windows scored", labels=["joint"])
    lost = CounterMetricFamily("lostmotion_windows_lost", "Windows lost, by reason", labels=["joint", "reason"])
    for joint, count in counts.items():
        triggered.add_metric([joint], count.triggered)
        scored.add_metric([joint], count.scored)
        for reason, number in dict(count.lost).items():
            lost.add_metric([joint, reason], number)
    yield from (triggered, scored, lost)


def _joints(reader: Reader) -> Iterator[Metric]:
    health = GaugeMetricFamily("lostmotion_joint_health", "1 for the joint's health", labels=["joint", "health"])
    rows = [(f"joint_{name}", text, of) for name, text, of in LAST] + list(SEVERITY)
    last = [(GaugeMetricFamily(f"lostmotion_{name}", text, labels=["joint"]), of) for name, text, of in rows]
    for joint in reader.joints():
        for state in Health:
            health.add_metric([joint.name, state.value], joint.health is state)
        if window := reader.last_window(joint.name):
            for family, of in last:
                family.add_metric([joint.name], of(window))
    yield from (health, *(family for family, _ in last))


def _alarms(reader: Reader) -> Metric:
    labels = ["joint", "cause", "severity", "state"]
    family = GaugeMetricFamily("lostmotion_alarm", "1 for each active alarm", labels=labels)
    for alarm in reader.active_alarms():
        family.add_metric([alarm.joint, alarm.cause.value, alarm.severity.value, alarm.state.value], 1.0)
    return family


def _devices(reader: Reader) -> Iterator[Metric]:
    reading = GaugeMetricFamily("lostmotion_device_reading", "1 while samples arrive", labels=["device"])
    samples = CounterMetricFamily("lostmotion_device_samples", "Samples since the start", labels=["device"])
    losses = CounterMetricFamily("lostmotion_device_losses", "Samples lost, by kind", labels=["device", "kind"])
    for device in reader.devices():
        reading.add_metric([device.name], device.state == "reading")
        samples.add_metric([device.name], device.samples)
        for kind in LOSSES:
            losses.add_metric([device.name, kind], getattr(device, kind))
    yield from (reading, samples, losses)
