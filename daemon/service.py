"""The service: startup, main loop, shutdown.  It calls the stages in order.

What goes wrong in one stage, sink or poller stays there (``fault_barrier``).
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

from lostmotion.daemon import counters, database, heap, logs
from lostmotion.daemon.alarm import Change
from lostmotion.daemon.alarm_manager import AlarmManager, is_over
from lostmotion.daemon.config import Config
from lostmotion.daemon.fault_barrier import FaultBarrier, run_poller
from lostmotion.daemon.learning import Learning
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory
from lostmotion.daemon.notify import Notifier
from lostmotion.daemon.periods import Periods
from lostmotion.daemon.records import Answer, JointRow, ScoreRow, WindowRow
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.signals import Flags
from lostmotion.daemon.sink_states import SinkStates
from lostmotion.daemon.sinks import Sink, SinkContext, registry
from lostmotion.daemon.sinks.log import LogSink
from lostmotion.daemon.stamps import Stamps
from lostmotion.daemon.store import Store
from lostmotion.daemon.tasks import Tasks
from lostmotion.daemon.watchdog import Watchdog
from lostmotion.drivers.clock import next_cycle
from lostmotion.drivers.errors import LostmotionError

if TYPE_CHECKING:
    from lostmotion.daemon.metrics import Exporter

__all__ = ["run"]

log = logging.getLogger(__name__)

AFTER_S = 0.01
"""the main thread wakes so long after each cycle has begun [s], when what came in until then has been read; half of a
cycle that is shorter.  With 3 ms some windows wait for another cycle (scores come up to 0.31 s after their windows,
99th percentile); with 10 and 20 ms after 0.21 to 0.23 s (``python -m bench.latency --cycle 0.2``)"""
SOON_S = 0.005
"""it wakes so often while an alarm is on its way to the disk, which is published when it is there [s]"""
LOOK_S = 1.0
"""how often devices are looked at [s]"""
CLOCK_S = 0.25
"""how often the system's clock is looked at [s]: stamps go on by the monotonic one in between"""
COUNTS_S = 10.0
"""how often the devices' counts go to the database, and unused memory to the system [s]"""
SUMMARY_S = 300.0
NOTICE_S = 60.0
"""how long the alarm about a database that was replaced is active; then it waits to be acknowledged [s]"""
FINISH_S = 3.0
"""how long a stopping service waits for open windows [s]"""


def run(config: Config, *, duration_s: float | None = None, reload: Callable[[], Config] | None = None) -> int:
    """Runs the service in the foreground until a signal, the end of a replay, or ``duration_s`` seconds of host time
    after the first device has been opened (a simulator may have to be compiled before that).

    SIGTERM and SIGINT finish the open windows; SIGHUP takes the configuration that ``reload`` returns, unless it raises
    any error or what it returns cannot be begun.  Returns the exit status: 0, or 1 when rows were lost because the disk
    refused them, or when it could not go on for lack of memory.  Raises StoreError when the database cannot be opened.
    """
    logs.setup()
    flags = Flags()
    ended = False
    with flags.installed():
        service = Service(config, reload, flags)
        service.startup()
        try:
            service.main_loop(duration_s)
        except Exception as error:
            if not is_no_memory(error):
                raise
            log.critical("%s; the service cannot go on and ends, to be started again", NO_MEMORY)
            ended = True
        finally:
            lost = service.shutdown()
    return 1 if lost or ended else 0


class Service:
    """One run of the service, from ``startup`` to ``shutdown``."""

    def __init__(self, config: Config, reload: Callable[[], Config] | None, flags: Flags) -> None:
        self._config = config
        self._reload = reload
        self._flags = flags
        self._notifier = Notifier()
        self._threads: list[threading.Thread] = []
        self._sinks: list[Sink] = []
        self._exporter: Exporter | None = None
        self._robot = Robot(config)
        self._store = _store(config)
        self._periods = Periods(CLOCK_S, LOOK_S, COUNTS_S, SUMMARY_S)
        self._watchdog = Watchdog(self._notifier)
        self._notice, self._notice_ends = "", 0.0
        if self._store.began_anew:
            self._tell_of_new_history(self._store.began_anew)
        self._taken_up: set[tuple[int, datetime]] = set()

    def startup(self) -> None:
        """Everything that has to be there before the first sample."""
        self._stamps = Stamps(self._robot.clock, self._store)
        self._flush_at = 0.0  # rows are committed in cycles of CYCLE_S, however short those of the robot are
        self._begin()
        self._notifier.ready()
        log.info("started: %s, database %s", _monitored(self._config), self._config.database.absolute())

    def main_loop(self, duration_s: float | None) -> None:
        """Steps until there is a reason to stop."""
        end = math.inf
        while not (self._flags.stop or self._robot.finished or time.monotonic() >= end):
            self._robot.inbox.waker.wait(self._pause())
            self._step()
            self._look_around()
            if duration_s is not None and end == math.inf and self._robot.is_open:
                end = time.monotonic() + duration_s
            if self._flags.reload:
                self._flags.reload = False
                self._take_new_configuration()
            elif self._tasks.reload:
                asked = self._tasks.reload
                refusal = self._take_new_configuration()
                self._store.add(Answer(asked, not refusal, refusal or "the service has taken the configuration"))

    def _pause(self) -> float:
        """For how long there is nothing to do [s], unless a virtual robot is read, or a device ends."""
        if self._store.is_settling:
            return SOON_S
        cycle = self._robot.clock.cycle_s
        now = time.monotonic() - min(AFTER_S, cycle / 2)
        return next_cycle(now, cycle) - now

    def shutdown(self) -> int:
        """Finishes what is open, in the order of the data's way; how many rows were lost."""
        self._notifier.stopping()
        self._barrier.call(self._finish)  # what waits is written all the same
        counters.log_summary(self._robot, self._store)
        lost = self._store.close()
        self._notifier.close()
        log.info("stopped")
        return lost

    # --- start and end of a configuration ---------------------------------------------------------------------------

    def _begin(self, known: Sequence[Change | ScoreRow] = (), earlier: Robot | None = None) -> None:
        """Starts the present configuration: health from the store, sinks, then the pollers.

        known: what the last configuration knew of the alarms, where it was on the same store.  A database that has been
        deleted since the last look at it would be read as one without alarms, and one on a full disk without the last.
        earlier: the robot until now, of which this one may know more than the database.
        """
        config = self._config
        self._stamps.follow(self._robot.clock, self._store)
        self._barrier = FaultBarrier(config.database)
        for note in config.notes:
            log.warning("%s", note)
        with self._store.reader() as reader:
            for attributor in self._robot.pipeline.attributors:
                attributor.resume(reader.origins())
            if earlier is not None:
                self._robot.continue_from(earlier)
            self._learning = Learning(self._robot, reader.noises(), reader.flanks())
        self._sinks, self._exporter = [], None
        opened = _sinks(config)
        self._sinks, self._sink_states = [LogSink(), *opened.values()], SinkStates(opened)
        self._exporter = _exporter(config, self._store, self._robot)
        if known:
            self._store.look()
            if self._store.damage is not None:
                self._renew_store(self._store.damage, known)
        self._alarm_manager = self._open_alarm_manager(known)
        self._tasks = self._open_tasks()
        self._threads = [
            threading.Thread(target=run_poller, args=(poller, self._robot.stop), name=poller.name, daemon=True)
            for poller in self._robot.pollers
        ]
        for thread in self._threads:
            thread.start()

    def _finish(self) -> None:
        """Waits for open windows (not for long), then ends pollers and sinks."""
        self._robot.pipeline.close()
        self._tasks.close()
        end = time.monotonic() + FINISH_S
        while self._robot.pipeline.open_windows and time.monotonic() < end:
            self._step()
            time.sleep(0.01)
        while self._barrier.call(self._robot.pipeline.learn):
            pass
        if self._robot.finished:
            self._robot.compare()
            self._look_at_joints(self._utc())
        self._robot.stop.set()
        for thread in self._threads:
            if thread.ident is not None:  # it was started: there may have been no memory for all of them
                thread.join(1.0)
        self._store.add(*self._learning.rows())
        self._store.add(*counters.rows(self._robot, self._utc()), *self._stamps.rows)
        self._alarm_manager.publish_settled(FINISH_S)
        self._alarm_manager.close()
        self._close_sinks()

    def _close_sinks(self) -> None:
        if self._exporter is not None:
            self._barrier.call(self._exporter.close)
        for sink in self._sinks:
            self._barrier.call(sink.close)

    def _take_new_configuration(self) -> str:
        """Replaces the running configuration; a bad one changes nothing.  Why it was not taken, "" when it was."""
        self._tasks.reload = 0
        if self._reload is None:
            refusal = "there is no configuration file to read again"
            log.warning("SIGHUP: %s", refusal)
            return refusal
        self._notifier.reloading()
        try:
            config = self._reload()
            robot = Robot(config)
            same = os.path.realpath(config.database) == os.path.realpath(self._config.database)
            store = self._store if same else _store(config)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever a file, or a driver of others, raises
            refusal = _log_kept_configuration(error)
        else:
            refusal = self._change_to(config, robot, store)
        self._notifier.ready()
        return refusal

    def _change_to(self, config: Config, robot: Robot, store: Store) -> str:
        """Ends the old configuration and starts the new; when that fails, starts the old one again and returns why."""
        old_config, old_store, old_robot = self._config, self._store, self._robot
        self._finish()
        known = self._alarm_manager.newest
        try:
            self._live(config, robot, store, known if store is old_store else (), old_robot)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - the same
            refusal = _log_kept_configuration(error)
            self._robot.stop.set()
            self._close_sinks()
            self._live(old_config, Robot(old_config), old_store, known, old_robot)
            unused = store
        else:
            log.info("configuration taken: %s", _monitored(config))
            refusal, unused = "", old_store
        if unused is not self._store:
            unused.close()
        return refusal

    def _live(
        self, config: Config, robot: Robot, store: Store, known: Sequence[Change | ScoreRow], earlier: Robot
    ) -> None:
        store.configure(config.robot.name, config.store.keep_windows_mb, config.store.keep_scores_days)
        self._config, self._robot, self._store = config, robot, store
        self._begin(known, earlier)

    def _leave_damaged_store(self, damage: Exception) -> None:
        """Goes on in a new database."""
        self._finish()
        known = self._alarm_manager.newest
        self._renew_store(damage, known)
        earlier, self._robot = self._robot, Robot(self._config)
        self._begin(known, earlier)

    def _renew_store(self, damage: Exception, known: Sequence[Change | ScoreRow]) -> None:
        """A new database, with the active alarms and what was not written yet; raises an alarm about it."""
        self._tell_of_new_history(database.explain(self._store.path, damage))
        self._store.begin_anew([row for row in known if not is_over(row)])
        self._store.settled(FINISH_S)

    def _tell_of_new_history(self, why: str) -> None:
        self._notice, self._notice_ends = f"a new history begins: {why}", time.monotonic() + NOTICE_S

    def _open_alarm_manager(self, known: Sequence[Change | ScoreRow] = ()) -> AlarmManager:
        joints = [joint.name for joint in self._config.joints]
        return AlarmManager(joints, self._config.alarm, self._store, self._publish, self._utc(), known)

    def _know_history(self) -> None:
        """The disk, which was full at the start, has let the database be opened, and has taken all that waited."""
        self._alarm_manager.close()
        self._tasks.close()
        self._alarm_manager = self._open_alarm_manager()
        self._tasks = self._open_tasks()

    def _open_tasks(self) -> Tasks:
        return Tasks(self._robot, self._store.reader(), self._store.path, self._utc, self._taken_up)

    def _utc(self) -> datetime:
        """The robot's time."""
        return self._stamps.utc(self._robot.clock.now())

    # --- the data's way ---------------------------------------------------------------------------------------------

    def _step(self) -> None:
        """Samples to windows, windows to scores, scores to store, alarm state and sinks."""
        if self._periods.is_due(CLOCK_S):
            self._stamps.look()
        done = self._barrier.call(self._robot.step) or ()
        for scored in done:
            if scored.failure is not None:
                self._barrier.report("the size of the play", scored.failure)
            utc = self._stamps.utc(scored.score.time)
            row = ScoreRow.of(scored.score, utc)
            for sink in self._sinks:
                self._barrier.call(sink.score, row)
            self._store.add(self._stamps.marked(row))
            if self._config.store.keep_windows_mb:
                self._store.add(WindowRow.of(scored.window, row.impact, utc, scored.commands))
            _, comparisons = self._robot.compared(self._config.joint(row.joint))
            self._barrier.call(self._alarm_manager.scored, row, scored.origin, comparisons)
        if self._store.is_settling:
            self._alarm_manager.publish_settled()
        has_learnt = not self._store.is_settling and self._barrier.call(self._robot.pipeline.learn)
        while self._robot.pipeline.is_behind:
            has_learnt = self._barrier.call(self._robot.pipeline.learn)
        if done or has_learnt:
            self._store.add(*self._learning.rows())
        if (now := time.monotonic()) >= self._flush_at:
            self._store.flush()
            self._flush_at = next_cycle(now)

    def _publish(self, change: Change, again: bool = False) -> None:
        for sink in self._sinks:
            if isinstance(change, JointRow):
                self._barrier.call(sink.health, change)
            else:
                self._barrier.call(sink.alarm, change, again)

    def _look_around(self) -> None:
        """What need not be done for every window: dead devices, alarms' delays, requests, trends, systemd, counts."""
        if self._periods.is_due(LOOK_S):
            self._store.look()
            if self._store.damage is not None:
                self._leave_damaged_store(self._store.damage)
            if self._alarm_manager.is_provisional and self._store.is_open and not self._store.waiting():
                self._know_history()
            utc = self._utc()
            self._look_at_joints(utc)
            self._store.add(*self._sink_states.look(utc))
            self._barrier.call(self._alarm_manager.take_requests, utc)
            self._store.add(*(self._barrier.call(self._tasks.take) or ()))
            self._barrier.call(self._alarm_manager.ask_trend, utc)
            self._alarm_manager.publish_settled()
            self._notifier.status(counters.status_line(self._robot, self._store, self._alarm_manager.healths))
        if self._periods.is_due(COUNTS_S):
            self._store.add(*counters.rows(self._robot, self._utc()), *self._stamps.rows)
            heap.give_back()
        if self._periods.is_due(SUMMARY_S):
            counters.log_summary(self._robot, self._store)
        self._watchdog.feed(self._robot)

    def _look_at_joints(self, utc: datetime) -> None:
        notice = self._notice if time.monotonic() < self._notice_ends else ""
        for joint in self._config.joints:
            fault, compared = self._robot.fault(joint), self._robot.compared(joint)
            self._alarm_manager.look(joint.name, fault or notice or fault, utc, *compared)


def _log_kept_configuration(error: BaseException) -> str:
    """Logs that the old configuration stays in use; the message."""
    if isinstance(error, LostmotionError):
        log.error("the old configuration stays: %s", error)
    elif is_no_memory(error):
        log.error("the old configuration stays: %s", NO_MEMORY)
        return f"the old configuration stays: {NO_MEMORY}"
    else:
        log.error("the old configuration stays: internal error: %r", error, exc_info=error)
    return f"the old configuration stays: {error}"


def _monitored(config: Config) -> str:
    joints = len(config.joints)
    return f"robot {config.robot.name}, {joints} joint{'' if joints == 1 else 's'}"


def _store(config: Config) -> Store:
    keep = config.store
    return Store(config.database, config.robot.name, keep.keep_windows_mb, keep.keep_scores_days, patient=True)


def _exporter(config: Config, store: Store, robot: Robot) -> Exporter | None:
    if config.metrics is None:
        return None
    from lostmotion.daemon.metrics import Exporter  # an HTTP server that many do not need

    return Exporter(config.metrics.listen, store, robot.pipeline.counts)


def _sinks(config: Config) -> dict[str, Sink]:
    context = SinkContext(config.robot.name, tuple(joint.name for joint in config.joints), config.database)
    return dict(zip((row.name for row in config.sinks), registry.opened(config.sinks, context), strict=True))
