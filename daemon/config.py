"""The configuration: TOML in, one frozen value out, or an error of one line.

Every key is checked, also those that belong to a driver; what only a device can answer is left to ``doctor`` and the
service.  Nothing here opens a port or a database.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
from msgspec import inspect

from lostmotion.daemon import bounds, config_notes, crosscheck
from lostmotion.daemon.options import (
    AlarmOptions,
    CanOptions,
    DetectorOptions,
    MetricsOptions,
    RobotTable,
    SinkOptions,
    StoreOptions,
    WebOptions,
    ZenohOptions,
)
from lostmotion.daemon.paths import expanded, state_folder
from lostmotion.daemon.sinks import SinkType
from lostmotion.daemon.sinks import registry as sink_registry
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers import registry, toml_text
from lostmotion.drivers.base import Accelerometer, AccelerometerOptions, Driver, JointOptions, RobotOptions, ServoBus
from lostmotion.drivers.clock import Clock, SystemClock
from lostmotion.drivers.errors import LostmotionError, UnknownDriverError
from lostmotion.drivers.textfile import TextFileError, near, read_text, shortened

__all__ = ["Config", "ConfigError", "default", "load", "loads"]

T = TypeVar("T")
Table = dict[str, Any]
OWN_TABLES = ("robot", "store", "accelerometer", "joint", "detector", "alarm", "metrics", "web")


class ConfigError(LostmotionError):
    """The configuration is wrong; the one-line message names the file, the key, what was found and expected."""


@dataclass(frozen=True, slots=True)
class Config:
    """A checked configuration.

    overrides: ``[joint.detector]`` by joint; robots: the drivers' own tables by driver; drivers: their rows of the
    table; sinks: ``[alarm.NAME]`` by their rows of the table; notes: what is allowed and yet worth saying, one line
    each.
    """

    robot: RobotTable
    store: StoreOptions
    accelerometers: tuple[AccelerometerOptions, ...]
    joints: tuple[JointOptions, ...]
    detector: DetectorOptions
    overrides: Mapping[str, DetectorOptions]
    alarm: AlarmOptions
    robots: Mapping[str, RobotOptions]
    drivers: Mapping[str, Driver]
    sinks: Mapping[SinkType, SinkOptions] = field(default_factory=dict)
    metrics: MetricsOptions | None = None
    web: WebOptions = field(default_factory=WebOptions)
    notes: tuple[str, ...] = ()

    @property
    def zenoh(self) -> ZenohOptions | None:
        """The options of the Zenoh sink, None without ``[alarm.zenoh]``."""
        return next((found for found in self.sinks.values() if isinstance(found, ZenohOptions)), None)

    @property
    def can(self) -> CanOptions | None:
        """The options of the CAN sink, None without ``[alarm.can]``."""
        return next((found for found in self.sinks.values() if isinstance(found, CanOptions)), None)

    @property
    def database(self) -> Path:
        """Where the database lies.  Raises PathError when ``~`` stands for no folder."""
        return expanded("store.path", self.store.path) if self.store.path else state_folder() / "history.db"

    def joint(self, name: str) -> JointOptions:
        """The joint of that name.  Raises ConfigError."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise ConfigError(f"no joint is called {name!r}; there are {', '.join(j.name for j in self.joints)}")

    def buses(self) -> list[tuple[JointOptions, ...]]:
        """The joints that share a driver and a port, together."""
        groups: dict[tuple[str, str], list[JointOptions]] = {}
        for joint in self.joints:
            groups.setdefault((joint.driver, joint.port), []).append(joint)
        return [tuple(group) for group in groups.values()]

    @property
    def is_virtual(self) -> bool:
        """Whether the robot has a time of its own: all its devices are of one driver, which waits for its reader."""
        return any(driver.waits for driver in self.drivers.values())

    def make_clock(self) -> Clock:
        """The clock of the robot."""
        driver = next(iter(self.drivers.values()))
        return driver.clock(self.robots[driver.name]) if driver.clock else SystemClock(self.robot.cycle_s)

    def make_bus(self, joints: Sequence[JointOptions], clock: Clock) -> ServoBus:
        """The bus of joints that share a port, not open.  Raises DriverError."""
        driver = self.drivers[joints[0].driver]
        assert driver.servo is not None  # checked when the configuration was decoded
        return driver.servo(joints, self.robots[driver.name], clock)

    def make_accelerometer(self, options: AccelerometerOptions, clock: Clock) -> Accelerometer:
        """An accelerometer, not open.  Raises DriverError."""
        driver = self.drivers[options.driver]
        assert driver.accelerometer is not None  # checked when the configuration was decoded
        return driver.accelerometer(options, self.robots[driver.name], clock)

    def accelerometer(self, name: str) -> AccelerometerOptions:
        """The accelerometer of that name, which must exist."""
        return next(sensor for sensor in self.accelerometers if sensor.name == name)

    def levers(self, joint: JointOptions) -> dict[str, float]:
        """Lever arms of a joint [m] at the accelerometers that feel it."""
        return {joint.accelerometer: self.accelerometer(joint.accelerometer).oscillator.length_m} | joint.levers_m

    def settings(self, joint: str) -> DetectorSettings:
        """The detector's settings for a joint: its oscillator, then ``[detector]``, then ``[joint.detector]``."""
        options = self.joint(joint)
        lever = self.levers(options)[options.accelerometer]
        return self._settings(self.accelerometer(options.accelerometer), lever, self.overrides.get(joint))

    def bar_settings(self, sensor: AccelerometerOptions) -> DetectorSettings:
        """Those for an accelerometer whatever moves it: its oscillator and what holds for the first joint on it."""
        first = next((joint.name for joint in self.joints if joint.accelerometer == sensor.name), "")
        return self._settings(sensor, sensor.oscillator.length_m, self.overrides.get(first))

    def _settings(
        self, sensor: AccelerometerOptions, length_m: float, override: DetectorOptions | None
    ) -> DetectorSettings:
        bar = {"f_res_hz": sensor.oscillator.f_res_hz, "zeta": sensor.oscillator.zeta, "length_m": length_m}
        given = self.detector.given() | (override.given() if override else {})
        return DetectorSettings(**cast(Any, bar | given))


def load(path: Path, *, joints: bool = True) -> Config:
    """Reads and checks a file; joints: whether it must have any, as all but an accelerometer alone needs.  Raises
    ConfigError."""
    try:
        text = read_text(path)
    except TextFileError as error:
        raise ConfigError(f"{error}; a configuration file was expected here") from error
    return loads(text, str(path), joints=joints)


def default(*, runs: bool = True) -> Config:
    """The built-in configuration: a simulated robot, its database in the user's state folder.

    runs: whether that robot is to run, for which a small installation has no packages.  Raises ConfigError.
    """
    path = Path(__file__).parent / "simulated.toml"
    return loads(read_text(path), str(path), runs=runs)


def loads(text: str, where: str, *, joints: bool = True, runs: bool = True) -> Config:
    """Checks a configuration given as text; ``where`` names it in messages; joints as of ``load``, runs as of
    ``default``.  Raises ConfigError."""
    try:
        tables = toml_text.loads(text)
        bounds.check(tables, "", _path)
        config = _decode(tables, joints)
        crosscheck.check(config, runs)
        return replace(config, notes=config_notes.notes(config))
    except (toml_text.TomlError, LostmotionError) as error:
        raise ConfigError(f"{where}: {shortened(error)}") from error


def _decode(tables: Table, needs_joints: bool) -> Config:
    joints = _list_of_tables(tables, "joint") if needs_joints or "joint" in tables else []
    overrides: dict[str, DetectorOptions] = {}
    decoded_joints: list[JointOptions] = []
    for index, table in enumerate(joints):
        path = _path("joint", index, table)
        own = {key: value for key, value in table.items() if key != "detector"}
        joint = _convert(own, _driver(own, path, "servo").joint_options, path)
        overrides[joint.name] = _convert(table.get("detector", {}), DetectorOptions, f"{path}.detector")
        decoded_joints.append(joint)
    sensors: list[AccelerometerOptions] = []
    for index, table in enumerate(_list_of_tables(tables, "accelerometer")):
        path = _path("accelerometer", index, table)
        sensors.append(_convert(table, _driver(table, path, "accelerometer").accelerometer_options, path))
    items: list[JointOptions | AccelerometerOptions] = [*decoded_joints, *sensors]
    drivers = {item.driver: registry.get_driver(item.driver) for item in items}
    _refuse_unknown_tables(tables, drivers)
    alarm, sinks = _sinks(tables.get("alarm", {}))
    return Config(
        robot=_convert(_required(tables, "robot"), RobotTable, "robot"),
        store=_convert(tables.get("store", {}), StoreOptions, "store"),
        accelerometers=tuple(sensors),
        joints=tuple(decoded_joints),
        detector=_convert(tables.get("detector", {}), DetectorOptions, "detector"),
        overrides=overrides,
        alarm=_convert(alarm, AlarmOptions, "alarm"),
        sinks=sinks,
        metrics=_convert(tables["metrics"], MetricsOptions, "metrics") if "metrics" in tables else None,
        web=_convert(tables.get("web", {}), WebOptions, "web"),
        robots={name: _convert(tables.get(name, {}), driver.robot_options, name) for name, driver in drivers.items()},
        drivers=drivers,
    )


def _sinks(table: object) -> tuple[object, dict[SinkType, SinkOptions]]:
    """``[alarm]`` without the tables of the sinks, and these."""
    if not isinstance(table, dict):
        return table, {}
    own = AlarmOptions.__struct_fields__
    sinks = {}
    for name, value in table.items():
        if name not in own:
            row = sink_registry.get_sink(name)
            if row is None:
                raise ConfigError(f"alarm.{name}: unknown key{near(name, sorted({*own, *sink_registry.names()}))}")
            sinks[row] = _convert(value, row.options, f"alarm.{name}")
    return {name: value for name, value in table.items() if name in own}, sinks


def _required(tables: Table, name: str) -> object:
    if name not in tables:
        raise ConfigError(f"[{name}] is missing")
    return tables[name]


def _list_of_tables(tables: Table, name: str) -> list[Table]:
    if name not in tables:
        raise ConfigError(f"[[{name}]] is missing; expected at least one such table")
    found = tables[name]
    if isinstance(found, dict):
        raise ConfigError(f"{name}: found [{name}], expected [[{name}]]: such a table may stand several times")
    if not isinstance(found, list) or not found or not all(isinstance(item, dict) for item in found):
        raise ConfigError(f"{name}: found {_shown(found)}, expected at least one [[{name}]] table")
    return found


def _path(kind: str, index: int, table: object) -> str:
    """``joint 'elbow'``, or where there is no name, ``joint[1]``."""
    name = table.get("name") if isinstance(table, dict) else None
    return f"{kind} {name!r}" if isinstance(name, str) else f"{kind}[{index}]"


def _driver(table: Table, path: str, role: str) -> Driver:
    name = table.get("driver")
    if not isinstance(name, str):
        raise ConfigError(f"{path}.driver: found {_shown(name)}, expected one of {', '.join(_drivers_of(role))}")
    try:
        driver = registry.get_driver(name)
    except UnknownDriverError as error:
        if name in registry.names():  # another package's, which is broken
            raise ConfigError(f"{path}.driver: {error}") from error
        raise ConfigError(
            f"{path}.driver: no driver is called {name!r}{near(name, sorted(_drivers_of(role)))}"
        ) from error
    if getattr(driver, role) is None:
        there = ", ".join(_drivers_of(role))
        raise ConfigError(f"{path}.driver: found {name!r}, which is no {role} ({driver.summary}); there are {there}")
    return driver


def _drivers_of(role: str) -> list[str]:
    """The names of the drivers that are a servo, or an accelerometer."""
    names = []
    for name in registry.names():
        with suppress(UnknownDriverError):  # another package's, which is broken
            if getattr(registry.get_driver(name), role) is not None:
                names.append(name)
    return names


def _refuse_unknown_tables(tables: Table, drivers: Mapping[str, Driver]) -> None:
    known = [*OWN_TABLES, *drivers]
    for name in tables:
        if name not in known:
            hint = (
                "; no joint or accelerometer uses that driver"
                if name in registry.names()
                else near(name, sorted(known))
            )
            raise ConfigError(f"{name}: unknown key{hint}")


def _convert(value: object, kind: type[T], path: str) -> T:
    try:
        return msgspec.convert(value, kind, strict=True)
    except msgspec.ValidationError as error:
        raise ConfigError(_explain(str(error), value, kind, path)) from error


def _explain(message: str, value: object, kind: type, path: str) -> str:
    """msgspec's message as ours: the key's full path first, then what was found and expected."""
    what, _, inner = message.partition(" - at `")
    inner = inner.rstrip("`").removeprefix("$")
    if unknown := re.match(r"Object contains unknown field `(.+)`", what):
        return f"{path}{inner}.{unknown[1]}: unknown key{near(unknown[1], sorted(_keys(_types_at(kind, inner))))}"
    if missing := re.match(r"Object missing required field `(.+)`", what):
        return f"{path}{inner}.{missing[1]}: is missing"
    if what.startswith("Invalid enum value"):
        what = f"expected {_choice(_types_at(kind, inner))}"
    if not what.startswith(("Expected", "Invalid", "Object", "expected")):  # the options' own check
        return f"{path}{inner}: {what}"
    what = toml_text.in_words(what)
    return f"{path}{inner}: found {_shown(toml_text.at(value, inner))}; {what[0].lower()}{what[1:]}"


def _types_at(kind: type, path: str) -> list[inspect.Type]:
    """What may stand at a path within an options type, a union taken apart."""
    types: list[inspect.Type] = [inspect.type_info(kind)]
    for key in re.findall(r"\w+", path):
        inner = [t.item_type for t in types if isinstance(t, inspect.ListType)] or [
            field.type
            for t in types
            if isinstance(t, inspect.StructType)
            for field in t.fields
            if field.encode_name == key
        ]
        types = [part for t in inner for part in (t.types if isinstance(t, inspect.UnionType) else (t,))]
    return types


def _keys(types: Sequence[inspect.Type]) -> list[str]:
    return [field.encode_name for t in types if isinstance(t, inspect.StructType) for field in t.fields]


def _choice(types: Sequence[inspect.Type]) -> str:
    """``a number or 'auto'``: words that are allowed, and other types, but for what TOML lacks."""
    names = [
        ", ".join(map(repr, t.values))
        if isinstance(t, inspect.LiteralType)
        else toml_text.WORDS.get(type(t).__name__[:-4].lower())
        for t in types
    ]
    return " or ".join(name for name in names if name)


def _shown(value: object) -> str:
    """A value as TOML writes it, or its kind."""
    if isinstance(value, str | int | float):
        return str(value).lower() if isinstance(value, bool) else repr(value)
    return {"NoneType": "nothing", "dict": "a table", "list": "a list"}.get(type(value).__name__, type(value).__name__)
