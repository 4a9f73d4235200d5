"""Counts of samples and windows, also of lost ones, as text and rows.  Reads no clock."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import datetime

from lostmotion.daemon.records import DeviceRow, Health, Origins
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.store import Store

__all__ = ["log_summary", "rows", "status_line"]

log = logging.getLogger(__name__)


def rows(robot: Robot, utc: datetime) -> Iterator[DeviceRow | Origins]:
    """The devices' counts and which joint the play comes from, for `status` and `doctor`."""
    yield Origins(tuple(attributor.origin for attributor in robot.pipeline.attributors))
    for poller in robot.pollers:
        of, ring = poller.status, robot.rings.get(poller.name)
        reason = of.reason or "; ".join(of.faults.values())
        overwritten = ring.overwritten if ring else 0
        counts = (of.samples, of.lost, of.late, of.broken, of.silent, overwritten)
        yield DeviceRow(poller.name, utc, of.state.value, reason, *counts)


def status_line(robot: Robot, store: Store, healths: Iterable[Health]) -> str:
    """One line for ``systemctl status``."""
    counts = robot.pipeline.counts.values()
    text = ", ".join(f"{number} {health}" for health, number in sorted(Counter(h.value for h in healths).items()))
    lost = sum((count.lost for count in counts), Counter[str]())
    text += f"; windows: {sum(count.scored for count in counts)} scored, {lost.total()} lost"
    return f"{text}; {store.problem}" if store.problem else text


def log_summary(robot: Robot, store: Store) -> None:
    """The counts of devices and windows as log lines, and what waits for the disk."""
    for poller in robot.pollers:
        of = poller.status
        log.info(
            "%s: %s samples=%d lost=%d late=%d broken=%d silent=%d",
            *(poller.name, of.state.value, of.samples, of.lost, of.late, of.broken, of.silent),
        )
    for name, count in robot.pipeline.counts.items():
        lost = ", ".join(f"{number} x {reason}" for reason, number in count.lost.items()) or "none"
        log.info("%s: windows triggered=%d scored=%d lost: %s", name, count.triggered, count.scored, lost)
    if store.problem:
        log.error("%s; %d rows wait in memory, %d were dropped", store.problem, store.waiting(), store.dropped)
