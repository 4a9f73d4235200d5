"""Broken bytes, lines and files at random: each is taken or refused in one line, and soon.

    python -m bench.fuzz [--inputs 100000] [--seed 0] [--only config …]

Sound inputs of every codec, recordings, configurations and models are damaged in a few places.  Bad is any error that
is not the reader's own, a refusal that is no short line, more than ``SLOW_S`` of processor time, and what contradicts
itself: a stream that reads otherwise when it comes in two pieces, a quick way that finds something else than the slow
one.  Each input depends on the seed and its number alone, and is printed where it is bad.
"""

from __future__ import annotations

import argparse
import logging
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from random import Random
from types import FrameType

import numpy as np
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn
from rosbags.rosbag2 import StoragePlugin
from tests.drivers import bags
from tests.drivers.wpilogs import of_sysid

from lostmotion.daemon import config
from lostmotion.daemon.robot import Robot
from lostmotion.drivers.codec import csv_line, dynamixel, servo_state, witmotion
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.formats.to_mcap import write_mcap
from lostmotion.drivers.recording import Recording, read_recording
from lostmotion.lab.models import modelfile

__all__ = ["KINDS", "Kind", "Outcome", "fuzz", "main"]

ROOT = Path(__file__).parent.parent
SLOW_S, ENDLESS_S = 2.0, 20.0
"""processor time of an input that is bad, and after which it is given up [s]"""
LONGEST_LINE = 2000
"""characters of a refusal"""
PIECES = (
    b"nan", b"inf", b"1e308", b"-1e308", b"1e-320", b"-0", b"9" * 30, b"9" * 5000, b"0x1p9", b"1_0", b"-", b",", b";",
    b"\n", b"\r", b"\t", b"\0", b"\xff\xff", b"\xff\xff\xfd\x00", b"\x55\x51", b'"', b"'", b'"""', b"[", b"]]", b"{",
    b"=", b".", b"#", b"# ", b"_", b"\\", b"\\u0000", b"\xef\xbb\xbf", "ü".encode(), b"true", b"0001-01-01T00:00:00Z",
)  # fmt: skip
OFTEN = 2000
"""a piece is repeated so often at most: what does not take linear time shows"""

Taker = Callable[[bytes, Random], bool]


class Endless(BaseException):
    """An input has taken too long; no reader catches this."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What reads some kind of input: ``sound`` ones, and ``take``, which says whether one was taken, or raises
    LostmotionError."""

    name: str
    sound: tuple[bytes, ...]
    take: Taker


@dataclass(slots=True)
class Outcome:
    """Of one kind: how many inputs, how many of them rejected, the slowest [s], and bad ones: by place, how often, and
    the first."""

    name: str
    inputs: int = 0
    rejected: int = 0
    slowest_s: float = 0.0
    bad: dict[str, tuple[int, str]] = field(default_factory=dict)


def damaged(sound: bytes, dice: Random) -> bytes:
    """A few bytes changed, added, taken away, doubled, or replaced by what readers have trouble with."""
    data = bytearray(sound)
    for _ in range(dice.randint(1, 4)):
        at, size = dice.randrange(len(data) + 1), dice.randint(1, 12)
        match dice.randrange(7):
            case 0:
                data[at : at + 1] = dice.randbytes(1)
            case 1:
                data[at:at] = dice.randbytes(size)
            case 2:
                del data[at : at + size]
            case 3:
                other = dice.randrange(len(data) + 1)
                data[at:at] = data[other : other + 4 * size]
            case 4:
                data[at:at] = dice.choice(PIECES)
            case 5:
                _replace_value(data, at, dice)
            case _:
                piece = dice.choice((bytes(data[at : at + size]), dice.choice(PIECES)[:size]))
                data[at:at] = piece * (dice.randint(2, OFTEN) if dice.random() < 0.05 else 2)
    return bytes(data)


def _replace_value(data: bytearray, at: int, dice: Random) -> None:
    """Another value between the next two marks of a text."""
    marks = [k for k in range(at, min(at + 200, len(data))) if data[k] in b"=,;\n[]{} "]
    if len(marks) > 1:
        begin, end = dice.choice([*pairwise(marks)])
        data[begin + 1 : end] = dice.choice(PIECES)


def fuzz(kind: Kind, inputs: int, seed: int = 0, moved: Callable[[int], object] = int) -> Outcome:
    """So many inputs of a kind; ``moved`` hears now and then how many are done.  In the main thread only."""
    outcome = Outcome(kind.name)
    before = signal.signal(signal.SIGVTALRM, _give_up)
    try:
        for number in range(inputs):
            dice = Random(f"{seed} {kind.name} {number}")
            data = damaged(dice.choice(kind.sound), dice)
            _try(kind, data, dice, outcome, number)
            if number % 100 == 99:
                moved(number + 1)
    finally:
        signal.signal(signal.SIGVTALRM, before)
    moved(inputs)
    return outcome


def _give_up(number: int, frame: FrameType | None) -> None:
    raise Endless


def _try(kind: Kind, data: bytes, dice: Random, outcome: Outcome, number: int) -> None:
    wrong = place = ""
    begun = time.thread_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, ENDLESS_S)
    try:
        outcome.rejected += not kind.take(data, dice)
    except LostmotionError as error:
        outcome.rejected += 1
        if "\n" in str(error) or not 0 < len(str(error)) <= LONGEST_LINE:
            place, wrong = "refusal", f"no short line: {error!s:.300}"
    except (Exception, Endless) as error:  # noqa: BLE001 - whatever a reader lets out is what is sought
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.name != _give_up.__name__]
        last = frames[-1]
        place = f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}"
        wrong = f"{place}: {error!s:.200}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    spent = time.thread_time() - begun
    outcome.inputs += 1
    outcome.slowest_s = max(outcome.slowest_s, spent)
    if spent > SLOW_S and not wrong:
        place = wrong = "slow"
    if wrong:
        shown = f"{data[:300]!r}{'…' if len(data) > 300 else ''}"
        often, first = outcome.bad.get(place, (0, f"input {number}, {spent:.2f} s: {wrong}: {shown}"))
        outcome.bad[place] = (often + 1, first)


# --- what is read -------------------------------------------------------------------------------------------------


def _packets(protocol: int) -> Taker:
    models = [model for model in servo_state.MODELS.values() if model.protocol == protocol]
    size = models[0].block_size
    question = dynamixel.Question(3, 36, size)

    def take(data: bytes, dice: Random) -> bool:
        found = dynamixel.decoder(protocol).feed(data)
        _same_in_pieces(dynamixel.decoder(protocol).feed, data, dice, found)
        question.parameters(data)
        for packet in found:
            block = packet.parameters[-size:] if packet else b""
            if len(block) == size:
                _is_state(dice.choice(models).decode(block))
        return None not in found

    return take


def _blocks(data: bytes, dice: Random) -> bool:
    """A servo's state: any block of the right size is one."""
    try:
        _is_state(dice.choice([*servo_state.MODELS.values()]).decode(data))
    except struct.error:
        return False
    return True


def _is_state(state: servo_state.ServoState) -> None:
    assert np.isfinite(state[:5]).all(), state


def _frames(data: bytes, dice: Random) -> bool:
    found = witmotion.WitDecoder().feed(data)
    _same_in_pieces(witmotion.WitDecoder().feed, data, dice, found)
    decoder = witmotion.WitDecoder()
    quick = decoder.accelerations(data)
    if quick is not None:
        rest = [frame and frame.values for frame in decoder.feed(b"")]  # what follows the last frame waits for more
        assert [*quick, *rest] == [frame and frame.values for frame in found], "the quick way finds something else"
    return None not in found


def _same_in_pieces(feed: Callable[[bytes], list[object]], data: bytes, dice: Random, found: Sequence[object]) -> None:
    """Where a stream is cut makes no difference."""
    at = dice.randrange(len(data) + 1)
    assert feed(data[:at]) + feed(data[at:]) == found, f"found otherwise when cut at {at}"


def _lines(data: bytes, dice: Random) -> bool:
    quick, slow = csv_line.CsvDecoder(), csv_line.CsvDecoder()
    for decoder in (quick, slow):
        decoder.feed(b"1\n1000,0.5\n2000,0.25\n3000,-0.5\n")
    table, rows = quick.table(data), slow.feed(data)
    if table is not None:
        assert [*map(tuple, table.tolist())] == rows, "the quick way finds something else"
    assert all(np.isfinite(row).all() for row in rows if row)
    return None not in rows


def _of_file(read: Callable[[Path], object], ending: str) -> Taker:
    """What reads a file instead of bytes."""
    memory = Path("/dev/shm")
    folder = memory if memory.is_dir() else Path(tempfile.gettempdir())

    def take(data: bytes, dice: Random) -> bool:
        with tempfile.NamedTemporaryFile(dir=folder, suffix=ending, buffering=0) as file:
            file.write(data)
            read(Path(file.name))
        return True

    return take


@contextmanager
def _silent() -> Iterator[None]:
    """Without what is told of a file of another program."""
    logging.disable()
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


def _recording(path: Path) -> None:
    with _silent():
        recording = read_recording(path)
    assert np.isfinite(recording.time).all()
    assert (np.diff(recording.time) >= 0).all()


def _files_of_others() -> tuple[bytes, bytes, bytes]:
    """A recording as Parquet, as MCAP and as the database of a rosbag2."""
    import pyarrow as pa
    from pyarrow import parquet

    times = np.arange(20) / 100
    recording = Recording(times, {"command": times, "position": times**2, "accel": -times})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parquet.write_table(pa.table({"t": times, "q": times**2, "tau": times, "w": [[1.0, 2.0]] * 20}), folder / "x")
        write_mcap(recording, "elbow", folder / "y")
        bags.write_rosbag(folder / "z", StoragePlugin.SQLITE3, count=4)
        (database,) = (folder / "z").glob("*.db3")
        return (folder / "x").read_bytes(), (folder / "y").read_bytes(), database.read_bytes()


def _bag(path: Path) -> None:
    with _silent():
        read_recording(path, "elbow")


def _config(path: Path) -> None:
    Robot(config.load(path))


def _files(*patterns: str) -> tuple[bytes, ...]:
    """Those that ship with the project."""
    return tuple(path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern)))


def _servo_frames(protocol: int) -> bytes:
    """Answers of servos, one after another."""
    size = next(model.block_size for model in servo_state.MODELS.values() if model.protocol == protocol)
    code, error = (dynamixel.STATUS, b"\0") if protocol == 2 else (0, b"")
    packets = (dynamixel.Packet(3 + k, code, error + bytes(range(k, k + size))) for k in range(3))
    return b"".join(dynamixel.encode(packet, protocol) for packet in packets)


WIT = b"".join(
    witmotion.encode(witmotion.WitFrame(kind, (k, -k, 2048 + k, 2500))) for k in range(4) for kind in (0x51, 0x52)
)
ACCELERATIONS = b"".join(witmotion.encode(witmotion.WitFrame(0x51, (k, -k, 2048, 2500))) for k in range(6))
CSV = b"".join(b"%d,%.4f\r\n" % (4000 + 1000 * k, 0.1 * k) for k in range(6))
RECORDING = b"""# f_res_hz = 58.0
# note = "bench"
# levers.elbow = [0.1, 0.2]
# time_unit = "ms"
time,command,accel,state
0,0.1,1.5,ok
10,,-3,"a, b"
20,0.3,4e-1,
30,-0.4,,
"""
PLAIN = b"time,command,position,accel\n" + b"".join(b"%.2f,%d,%d,%.1f\n" % (k / 100, k, k, k / 7) for k in range(20))
TABLE = b'# angle_unit = "deg"\n"Time (ms)";angle;tau [Nm]\n' + b"".join(b"%d,5;%d;\n" % (10 * k, k) for k in range(20))
SINKS = b"""
[alarm]
windows = 20
play_warning = 0.002
[alarm.zenoh]
mode = "peer"
listen = ["tcp/127.0.0.1:7447"]
[alarm.can]
interface = "socketcan"
channel = "can0"
node_id = 5
[metrics]
listen = "127.0.0.1:9464"
[detector]
level = 4.0
window_s = 0.25
"""


def kinds() -> tuple[Kind, ...]:
    """All kinds of input."""
    configs = _files("daemon/*.toml", "examples/arm.toml", "systemd/*.toml")
    configs += tuple(text + SINKS for text in configs if b"[detector]" not in text and b"[alarm" not in text)
    parquet, mcap, bag = _files_of_others()
    return (
        Kind("csv lines", (CSV,), _lines),
        Kind("witmotion", (WIT, ACCELERATIONS), _frames),
        Kind("dynamixel 1", (_servo_frames(1),), _packets(1)),
        Kind("dynamixel 2", (_servo_frames(2),), _packets(2)),
        Kind("servo states", tuple({bytes(m.block_size) for m in servo_state.MODELS.values()}), _blocks),
        Kind("recordings", (RECORDING, PLAIN), _of_file(_recording, ".csv")),
        Kind("tables as text", (TABLE,), _of_file(_recording, ".txt")),
        Kind("Parquet", (parquet,), _of_file(_recording, ".parquet")),
        Kind("MCAP", (mcap,), _of_file(_recording, ".mcap")),
        Kind("rosbag2", (bag,), _of_file(_bag, ".db3")),
        Kind("WPILib data logs", (of_sysid()[0].data[:4000],), _of_file(_recording, ".wpilog")),
        Kind("configurations", configs, _of_file(_config, ".toml")),
        Kind("models", _files("examples/models/*.toml"), _of_file(modelfile.load, ".toml")),
    )


KINDS = kinds()


def main(arguments: Sequence[str] = ()) -> int:
    """Prints a table, and what was bad; 1 when anything was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000, help="how many of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=[kind.name for kind in KINDS], help="these kinds")
    given = parser.parse_args(arguments)
    chosen = [kind for kind in KINDS if not given.only or kind.name in given.only]
    outcomes = []
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        for kind in chosen:
            task = progress.add_task(kind.name, total=given.inputs)
            outcomes.append(
                fuzz(kind, given.inputs, given.seed, lambda done, task=task: progress.update(task, completed=done))
            )
    show(outcomes)
    return int(any(outcome.bad for outcome in outcomes))


def show(outcomes: Sequence[Outcome]) -> None:
    """The table, and the first input of each kind of badness."""
    print(f"{'kind':<16}{'inputs':>9}{'rejected':>10}{'slowest ms':>12}{'bad':>6}")
    for outcome in outcomes:
        bad = sum(often for often, _ in outcome.bad.values())
        print(f"{outcome.name:<16}{outcome.inputs:>9}{outcome.rejected:>10}{1e3 * outcome.slowest_s:>12.1f}{bad:>6}")
    for outcome in outcomes:
        for often, first in outcome.bad.values():
            print(f"{outcome.name}, {often} times, the first {first}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
