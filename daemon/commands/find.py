"""``lostmotion doctor --find``: what is plugged in, and a configuration to start from."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.find_config import configuration
from lostmotion.drivers.probe.kernel import CanFound, IioFound, can_interfaces, iio_accelerometers
from lostmotion.drivers.probe.port import Look, look
from lostmotion.drivers.probe.ports import SerialPlace, place, places
from lostmotion.drivers.probe.streams import Chatter

__all__ = ["FoundPort", "find"]


@dataclass(frozen=True, slots=True)
class FoundPort:
    """A serial port and what was found on it; ``found`` is None where it was not probed, and ``why`` has the reason."""

    port: SerialPlace
    found: Look | None
    why: str = ""


def find(named: Sequence[str], target: Path | None, as_json: bool) -> int:
    """Prints what was found, and writes the configuration to a new file; 1 when nothing was.  Raises OutputError."""
    if target is not None:
        output.refuse_existing(target)
    sys.stderr.write(
        "listening, then asking silent ports (up to half a minute each); no setting of a device is changed\n"
    )
    chosen = [place(port) for port in named] or places()
    ports = _looks(chosen, asked=bool(named))
    cans, chips = ([], []) if named else (can_interfaces(), iio_accelerometers())
    text = configuration([(each.port.stays, each.found) for each in ports if each.found is not None])
    if target is not None and text:
        output.write_new(target, text)
    written = str(target) if target is not None and text else None
    if as_json:
        output.print_json(_document(ports, cans, chips, text, written))
    else:
        _print(ports, cans, chips)
        output.print_lines([_closing(text, written)])
    return int(not text and not cans and not chips)


def _looks(chosen: Sequence[SerialPlace], asked: bool) -> list[FoundPort]:
    """All free ports at the same time; those of the board, on which a console may wait, only when asked for."""
    with _progress() as bar, ThreadPoolExecutor(max_workers=max(1, len(chosen))) as pool:

        def one(port: SerialPlace) -> FoundPort:
            if port.users:
                return FoundPort(port, None, f"in use by {', '.join(port.users)}: left alone")
            if not port.usb and not asked:
                return FoundPort(port, None, f"a port of the board: not probed; --port {port.path} probes it")
            return FoundPort(port, look(port.path, bar(port.path)))

        return list(pool.map(one, chosen))


@contextmanager
def _progress() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """Bars on stderr, on a terminal only; gives a function of a port that gives one of the share that is done."""
    if not sys.stderr.isatty():
        yield lambda name: lambda share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:

        def bar(name: str) -> Callable[[float], None]:
            task = progress.add_task(name, total=1.0)
            return lambda share: progress.update(task, completed=share)

        yield bar


def _document(
    ports: Sequence[FoundPort], cans: Sequence[CanFound], chips: Sequence[IioFound], text: str, written: str | None
) -> dict[str, Any]:
    return {
        "ports": [_port(each) for each in ports],
        "can": [asdict(can) for can in cans],
        "iio": [asdict(chip) for chip in chips],
        "configuration": text or None,
        "written": written,
    }


def _port(each: FoundPort) -> dict[str, Any]:
    found = each.found or Look()
    chatter = asdict(found.chatter) | {"begins": repr(found.chatter.begins)} if found.chatter else None
    return {
        "path": each.port.path,
        "stays": each.port.stays,
        "adapter": each.port.adapter,
        "users": list(each.port.users),
        "probed": each.found is not None,
        "why": each.why or found.error,
        "complete": found.complete,
        "servos": [asdict(servo) for servo in found.servos],
        "sensor": asdict(found.sensor) if found.sensor else None,
        "chatter": chatter,
    }


def _print(ports: Sequence[FoundPort], cans: Sequence[CanFound], chips: Sequence[IioFound]) -> None:
    for each in ports:
        also = f"{each.port.path}, " if each.port.stays != each.port.path else ""
        output.print_lines([f"{each.port.stays} ({also}{each.port.adapter})"])
        output.print_lines([f"    {line}" for line in _words(each)])
    output.print_lines([f"{can.name} (CAN)\n    {_can_words(can)}" for can in cans])
    output.print_lines([f"{chip.device} (IIO)\n    accelerometer {chip.name} of the kernel's" for chip in chips])
    if not (ports or cans or chips):
        output.print_lines(["no serial port, CAN interface or IIO accelerometer; is the adapter plugged in?"])


def _words(each: FoundPort) -> list[str]:
    found = each.found
    if found is None:
        return [each.why]
    lines = _servo_words(found)
    if found.sensor is not None:
        sensor = found.sensor
        lines.append(f"{sensor.driver} at {sensor.rate_hz:g} Hz, {sensor.baudrate} baud: {sensor.told}")
    if found.chatter is not None:
        lines.append(_chatter_words(found.chatter))
    if not found.complete:
        lines.append("the time was over before every baud rate and id was tried")
    return lines or [found.error or "silent: nothing came in, and no servo answered at any baud rate"]


def _servo_words(found: Look) -> list[str]:
    """A line for all servos of one kind."""
    kinds: dict[str, list[int]] = {}
    for servo in found.servos:
        model = f"{servo.driver} {servo.model or 'of unknown model'} (model number {servo.number})"
        kinds.setdefault(f"{model}, {servo.baudrate} baud, protocol {servo.protocol}.0", []).append(servo.id)
    return [f"{kind}: id {', '.join(map(str, ids))}" for kind, ids in kinds.items()]


def _chatter_words(chatter: Chatter) -> str:
    if chatter.protocol:
        frames = f"frames of servos (protocol {chatter.protocol}.0, {chatter.baudrate} baud"
        return f"{frames}, {chatter.bytes_per_s:.0f} bytes/s) that another master talks to: nothing was asked"
    what = f"{chatter.bytes_per_s:.0f} bytes/s, {chatter.printable:.0%} printable at {chatter.baudrate} baud"
    return f"unknown: {what}, begins {chatter.begins!r}: nothing was asked"


def _can_words(can: CanFound) -> str:
    rate = f"{can.bitrate} bit/s" if can.bitrate else "bit rate unknown"
    if can.error:
        return f"{rate}; {can.error}"
    nodes = f"nodes {', '.join(map(str, can.nodes))}" if can.nodes else "no heartbeat"
    sync = f", SYNC at {can.sync_hz:g} Hz" if can.sync_hz else ""
    return f"up, {rate}: {can.frames} frames received, {nodes}{sync}"


def _closing(text: str, written: str | None) -> str:
    if written:
        return f"{written}: written; look at the lines that say FILL IN, then: lostmotion config check {written}"
    if text:
        return "-o robot.toml writes a configuration to start from"
    return "no servo or sensor was found: is the power on, and the port free?"
