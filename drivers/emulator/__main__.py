"""``python -m lostmotion.drivers.emulator``: prints the ports of emulated devices and serves them until killed."""

from __future__ import annotations

import contextlib
import signal
import sys
import termios
import threading
from pathlib import Path

import click

from lostmotion.drivers.codec import feetech
from lostmotion.drivers.codec.servo_state import MODELS
from lostmotion.drivers.emulator import (
    CanopenLine,
    CsvStream,
    Device,
    Emulator,
    FeetechLine,
    MasteredLine,
    Motion,
    ServoLine,
    Taps,
    WitMotionStream,
)

SHORT_NAMES = {"ax12": "AX-12A", "xl330": "XL330-M288", "xm430": "XM430-W350", "sts3215": "STS3215"}

SENSOR_NODE = 32
"""of the accelerometer on an emulated CAN bus"""


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--servos", multiple=True, metavar="MODEL:ID,ID…", help="A line of servos, such as ax12:1,2,3.")
@click.option(
    "--canopen",
    multiple=True,
    metavar="NODE,NODE…",
    help="A CAN bus behind an slcan adapter: CiA 402 drives, their master, and node 32, a CiA 404 sensor at 1 kHz.",
)
@click.option("--accel", multiple=True, metavar="KIND:RATE", help="csv:1000 (t_us,value), values:1000, witmotion:200.")
@click.option("--play", default=1.0, show_default=True, help="Play of the last servo, in units of 4 mrad (14').")
@click.option(
    "--levers",
    default="0.1",
    show_default=True,
    metavar="M,M…",
    help="Lever arms of the servos at the accelerometers, in their order; one: of the last servo only.",
)
@click.option("--taps", type=float, metavar="S", help="Nothing moves; the bar is flicked every so many seconds.")
@click.option("--baudrate", type=int, metavar="N", help="Be understood at this baud rate only, as on a real line.")
@click.option("--mastered", is_flag=True, help="The servos have a master; the port is that of a second adapter.")
@click.option("--link", type=click.Path(path_type=Path), help="Also make symbolic links LINK.0, LINK.1, …")
def main(
    servos: tuple[str, ...],
    canopen: tuple[str, ...],
    accel: tuple[str, ...],
    play: float,
    levers: str,
    taps: float | None,
    baudrate: int | None,
    mastered: bool,
    link: Path | None,
) -> None:
    """Emulates servos and accelerometers on pseudo-terminals: one path a line, servos first, then runs until killed.

    A terminal also shows what is there.

    All make one motion, each later than the next; the teeth of the last servo strike after the reversals of its goal.
    """
    motion = Taps(taps) if taps else Motion(play, levers=_levers(levers))
    lines = [_servos(text, motion) for text in servos]
    devices: list[Device] = [MasteredLine(line) for line in lines] if mastered else [*lines]
    devices += [_bus(text, motion) for text in canopen]
    devices += [_accelerometer(text, motion) for text in accel]
    kinds = ["servos" + ", overheard" * mastered] * len(servos) + ["CAN bus, slcan"] * len(canopen)
    names = zip([*kinds, *["accelerometer"] * len(accel)], [*servos, *canopen, *accel], strict=True)
    if not devices:
        raise click.UsageError("nothing to emulate; give --servos, --canopen or --accel")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the links are taken away
    if baudrate is not None and not hasattr(termios, f"B{baudrate}"):
        raise click.BadParameter(f"--baudrate: {baudrate} is none that Linux has a name for, such as 57600 or 1000000")
    with Emulator(*devices, link=link, baudrate=baudrate) as emulator, contextlib.suppress(KeyboardInterrupt):
        for path, (kind, given) in zip(emulator.paths, names, strict=True):
            click.echo(f"{path}  {kind} {given}" if sys.stdout.isatty() else path)
        threading.Event().wait()


def _levers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(lever) for lever in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: lever arms are numbers in metres, as in 0.25,0.1") from error


def _servos(text: str, motion: Motion) -> ServoLine:
    name, _, ids = text.partition(":")
    model = SHORT_NAMES.get(name.lower(), name)
    line = FeetechLine if model in feetech.MODELS else ServoLine
    if model not in MODELS and line is ServoLine:
        known = [*SHORT_NAMES, *MODELS, *feetech.MODELS]
        raise click.BadParameter(f"no servo is called {name!r}; there are {', '.join(known)}")
    try:
        return line.of(model, [int(id) for id in ids.split(",")], motion)
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: ids are whole numbers, as in ax12:1,2,3") from error


def _bus(text: str, motion: Motion) -> CanopenLine:
    try:
        return CanopenLine([int(node) for node in text.split(",")], motion, sensor=SENSOR_NODE)
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: nodes are whole numbers, as in 1,2,3") from error


def _accelerometer(text: str, motion: Motion) -> Device:
    kind, _, rate_text = text.partition(":")
    try:
        rate = float(rate_text)
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: the rate is a number, as in csv:1000") from error
    if kind == "witmotion":
        return WitMotionStream(motion, rate)
    if kind in ("csv", "values"):
        return CsvStream(motion, rate, stamps=kind == "csv")
    raise click.BadParameter(f"no accelerometer is called {kind!r}; there are csv, values, witmotion")


if __name__ == "__main__":
    main()
