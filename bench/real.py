"""What `lab explain` says of real measurements: `python -m bench.real [--budget 180s] [--change mirrored] [CASE ...]`.

Runs every case of ``cases.toml`` in the folder of measurements (LOSTMOTION_DATA, or ../shared/data beside the project)
through the command line, as a user would, and prints verdict, errors and seconds.  A case states the model file's text,
the recordings, and what must and must not be named.  With --change the recordings are changed in a way that leaves the
physics as it is, and with it the answer: mirrored, every second row, later, or another one last.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lostmotion.drivers.recording import Recording, read_recording, write_recording

DATA = Path(os.environ.get("LOSTMOTION_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
LIMIT_S = 300.0
PROGRAM = "from lostmotion.daemon.cli import main; main()"


@dataclass(frozen=True)
class Answer:
    """One case: the document that the command printed, or {} with a reason; seconds that it took."""

    name: str
    document: dict[str, Any]
    reason: str
    seconds: float

    def is_right(self, case: dict[str, Any]) -> bool:
        """Whether all that must be named is, and nothing that must not be."""
        missing = self.document.get("missing", [])
        first, need, never = (case.get(key, []) for key in ("first", "need", "not"))
        leads = not first or bool(missing and missing[0] in first)
        return bool(self.document) and leads and set(need) <= set(missing) and not set(never) & set(missing)


def mirrored(recording: Recording) -> Recording:
    """The other way round."""
    signed = {"command", "position", "torque", "force", "displacement", "accel", "voltage", "current"}
    return replace(recording, columns={k: -v if k in signed else v for k, v in recording.columns.items()})


def thinned(recording: Recording) -> Recording:
    """Every second row."""
    return replace(recording, time=recording.time[::2], columns={k: v[::2] for k, v in recording.columns.items()})


def later(recording: Recording) -> Recording:
    """With a clock that began three hours earlier."""
    return replace(recording, time=recording.time + 12345.0)


CHANGES: Mapping[str, Callable[[Recording], Recording]] = {
    "mirrored": mirrored, "thinned": thinned, "later": later, "turned": lambda recording: recording,
}  # fmt: skip
"""By name; "turned" changes the order: the last recording, which judges, comes first."""


def changed(case: dict[str, Any], change: str, folder: Path, data: Path = DATA) -> dict[str, Any]:
    """The case with changed recordings, written into the folder."""
    paths = []
    for at, name in enumerate(case["recordings"]):
        recording = replace(CHANGES[change](read_recording(data / name)), extra={})
        paths.append(folder / f"{at}-{Path(name).name}")
        write_recording(recording, paths[-1])
    paths = paths[-1:] + paths[:-1] if change == "turned" else paths
    return {**case, "recordings": [str(path) for path in paths]}


def asked(name: str, case: dict[str, Any], folder: Path, budget: str = "60s", data: Path = DATA) -> Answer:
    """What the command line says; budget: longer on busy cores; data: the folder of the recordings."""
    model = folder / f"{name}.toml"
    model.write_text(case["model"])
    recordings = [str(data / each) for each in case["recordings"]]
    command = [sys.executable, "-c", PROGRAM, "lab", "explain", str(model), *recordings, "--json", "--budget", budget]
    began = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Answer(name, {}, f"no answer in {LIMIT_S:g} s", LIMIT_S)
    seconds = time.monotonic() - began
    if done.returncode:
        return Answer(name, {}, done.stderr.strip().splitlines()[-1], seconds)
    return Answer(name, json.loads(done.stdout), "", seconds)


def main() -> None:
    """Prints a row for each case, as it is answered."""
    file = DATA / "cases.toml"
    if not file.exists():
        sys.exit(f"{file}: there are no real measurements here; set LOSTMOTION_DATA to their folder")
    cases = tomllib.loads(file.read_text())
    parser = argparse.ArgumentParser(prog="python -m bench.real", description=__doc__)
    parser.add_argument("--budget", default="60s")
    parser.add_argument("--change", choices=list(CHANGES))
    parser.add_argument("cases", nargs="*")
    given = parser.parse_args()
    chosen = given.cases or list(cases)
    if unknown := sorted(set(chosen) - set(cases)):
        sys.exit(f"found {', '.join(unknown)}, expected names of cases: {', '.join(cases)}")
    table = Table("case", "right", "verdict", "missing", "error before", "after", "noise", "unit", "s", box=None)
    right = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            case = changed(cases[name], given.change, Path(folder)) if given.change else cases[name]
            answer = asked(name, case, Path(folder), given.budget)
            is_right, document = answer.is_right(case), answer.document
            right += is_right
            error = document.get("error", {"before": 0.0, "after": 0.0, "noise": 0.0, "unit": ""})
            figures = [f"{error[key]:.3g}" for key in ("before", "after", "noise")]
            named = ", ".join(document.get("missing", [])) or answer.reason
            verdict = document.get("verdict", "none")
            table.add_row(
                name, "yes" if is_right else "NO", verdict, named, *figures, error["unit"], f"{answer.seconds:.0f}"
            )
            print(f"{name}: {'right' if is_right else 'WRONG'}, {named}, {answer.seconds:.0f} s", file=sys.stderr)
    Console(width=200).print(table)
    print(f"{right} of {len(chosen)} right")


if __name__ == "__main__":
    main()
