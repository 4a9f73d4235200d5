"""The service's own tables of the configuration, as typed values with their defaults and ranges.

The tables of joints, sensors and robots belong to the drivers (``drivers/base.py``); nothing here reads a file.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from lostmotion.detector.window import Statistic
from lostmotion.drivers.clock import CYCLE_S

__all__ = [
    "AlarmOptions",
    "CanOptions",
    "DetectorOptions",
    "MetricsOptions",
    "RobotTable",
    "SinkOptions",
    "StoreOptions",
    "WebOptions",
    "ZenohOptions",
]

Positive = Annotated[float, Meta(gt=0)]
Share = Annotated[float, Meta(gt=0, le=1)]


class RobotTable(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[robot]``: its name, and how often its hardware is read and its windows are scored [s]."""

    name: str
    cycle_s: Annotated[float, Meta(ge=0.005, le=1.0)] = CYCLE_S


class StoreOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[store]``: the database's path ("" means the user's state folder), how much raw data is kept [MB], and after
    how many days only one score an hour is kept (0: never)."""

    path: str = ""
    keep_windows_mb: Annotated[float, Meta(ge=0)] = 100.0
    keep_scores_days: Annotated[float, Meta(ge=0)] = 730.0


class DetectorOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[detector]`` and ``[joint.detector]``: what is not given comes from the table above, at last from
    ``DetectorSettings``; "auto" lets the detector choose."""

    window_s: Positive | Literal["auto"] | UnsetType = UNSET
    f_width_hz: Positive | UnsetType = UNSET
    f_norm_hz: Positive | UnsetType = UNSET
    f_norm_width_hz: Positive | UnsetType = UNSET
    level: Positive | UnsetType = UNSET
    min_acceleration: Positive | Literal["auto"] | UnsetType = UNSET
    statistic: Statistic | UnsetType = UNSET
    noise_ms2: Positive | UnsetType = UNSET
    noise_colour: tuple[float, ...] | UnsetType = UNSET
    flank_exponent: Annotated[float, Meta(ge=1)] | UnsetType = UNSET
    contact_accel: Positive | UnsetType = UNSET
    play_size: bool | UnsetType = UNSET
    gentle: Annotated[float, Meta(ge=0)] | UnsetType = UNSET
    follow_bar: bool | UnsetType = UNSET

    def given(self) -> dict[str, object]:
        """The keys that were given, in the names and values of DetectorSettings."""
        return {
            key: None if value == "auto" else value
            for key, value in msgspec.structs.asdict(self).items()
            if value is not UNSET
        }


class SinkOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[alarm.NAME]``: each sink has its own keys."""


class ZenohOptions(SinkOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[alarm.zenoh]``: how the session is opened; multicast scouting is off unless asked for.

    config: a file of Zenoh's own (JSON5), for TLS, access control and whatever else it knows; what is given here counts
    more than what stands there.  mode None: the one in the file, else "peer".  ros2: whether /diagnostics is sent as
    well, in ROS's domain ros2_domain.
    """

    mode: Literal["peer", "client", "router"] | None = None
    connect: list[str] = []
    listen: list[str] = []
    multicast_scouting: bool = False
    config: str = ""
    ros2: bool = False
    ros2_domain: Annotated[int, Meta(ge=0, le=232)] = 0


class CanOptions(SinkOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[alarm.can]``: the bus, by python-can's names, and the CANopen node; options: what else it takes."""

    interface: str
    channel: str
    node_id: Annotated[int, Meta(ge=1, le=127)]
    bitrate: Annotated[int, Meta(gt=0)] | None = None
    heartbeat_s: Annotated[float, Meta(ge=0.01, le=65.5)] = 1.0
    options: dict[str, str | int | float | bool] = {}


class MetricsOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[metrics]``: where Prometheus may ask; without the table nothing listens."""

    listen: str = "127.0.0.1:9464"


class WebOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[web]``: where ``lostmotion web`` serves its page, and who may see it.

    password_hash: an Argon2 hash, from ``lostmotion web --hash-password``; token_file: a file that holds a token for
    programs; one of them is required beyond this computer.  certificate, key: files for TLS.  lab: the folder of the
    lab's recordings and runs ("" means ``lab`` beside the database); upload_mb: of one recording [MB]; own_effects:
    effects of the owner's own (file.py:function) that the page may use, which runs those files.
    """

    listen: str = "127.0.0.1:8737"
    password_hash: str = ""
    token_file: str = ""
    certificate: str = ""
    key: str = ""
    lab: str = ""
    upload_mb: Annotated[float, Meta(gt=0, le=2000)] = 64.0
    own_effects: list[str] = []


class AlarmOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[alarm]``: the last ``windows`` scored windows of a joint decide on its health (``evidence.py``).

    degraded, warning: share of them above the level; severity_warning, severity_error: median equivalent play [rad],
    where most windows exclude that there is none; play_warning, play_error: median size of the play [rad], None for no
    limit; error: median score as a multiple of the level, None for no limit; trend_days: a trend that reaches
    severity_warning sooner (of the score: the level) is DEGRADED, 0: none is; deadband: share of its limit by which
    a figure has to fall until a severity is left; on_delay_s, off_delay_s: how long a cause has to stand, or to be
    gone, before the alarm changes [s]; remind: of an alarm that is not acknowledged; judged_within_h: a joint without a
    sound window for so long is DEGRADED [h]; 0: no limit.
    """

    windows: Annotated[int, Meta(ge=3, le=10000)] = 20
    degraded: Share = 0.2
    warning: Share = 0.5
    severity_warning: Positive = 5.8e-3
    severity_error: Positive = 17.5e-3
    error: Annotated[float, Meta(gt=1)] | None = None
    play_warning: Positive | None = None
    play_error: Positive | None = None
    trend_days: Annotated[float, Meta(ge=0)] = 30.0
    deadband: Annotated[float, Meta(ge=0, lt=1)] = 0.4
    on_delay_s: Annotated[float, Meta(ge=0, le=86400)] = 0.0
    off_delay_s: Annotated[float, Meta(ge=0, le=86400)] = 10.0
    remind: Literal["once", "daily", "rarer"] = "daily"
    judged_within_h: Annotated[float, Meta(ge=0)] = 24.0
