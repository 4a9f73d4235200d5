"""What `lab explain` says of real measurements: `python -m bench.real [--budget 180s] [CASE ...]`.

Runs every case of ``cases.toml`` in the folder of measurements (LOSTMOTION_DATA, or ../shared/data beside the project)
through the command line, as a user would, and prints verdict, errors and seconds.  A case states the model file's text,
the recordings, and what must and must not be named.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

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
    given = sys.argv[1:]
    budget = given[1] if given[:1] == ["--budget"] and given[1:] else "60s"
    chosen = (given[2:] if given[:1] == ["--budget"] else given) or list(cases)
    if unknown := sorted(set(chosen) - set(cases)):
        sys.exit(f"found {', '.join(unknown)}, expected names of cases: {', '.join(cases)}")
    table = Table("case", "right", "verdict", "missing", "error before", "after", "noise", "unit", "s", box=None)
    right = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            answer = asked(name, cases[name], Path(folder), budget)
            is_right, document = answer.is_right(cases[name]), answer.document
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
