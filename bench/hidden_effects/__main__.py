"""Arguments of the bench, `python -m bench.hidden_effects generate DIR …` and `… run …`: the package says how."""

from __future__ import annotations

import argparse
import hashlib
import json
import shlex
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console

from bench.hidden_effects.answers import ask_all
from bench.hidden_effects.cases import KINDS, draw_case, write_case
from bench.hidden_effects.mujoco_joint import available
from bench.hidden_effects.scoring import Score, score
from bench.hidden_effects.totals import document, print_tables

__all__ = ["main"]

COUNTS = {"strong": 20, "moderate": 20, "nothing": 10, "pair": 8, "outside": 7, "bounces": 4, "joint": 4}
LIMIT_S = 600.0
GENERATOR = ("cases", "catalogue", "motion", "mujoco_joint", "physics", "sizing")


def main(arguments: Sequence[str] | None = None) -> None:
    """Writes cases, or runs and scores them."""
    parser = argparse.ArgumentParser(prog="python -m bench.hidden_effects", description=__doc__)
    commands = parser.add_subparsers(dest="action", required=True)
    generate = commands.add_parser("generate", help="write cases, each into its own folder, and print the folders")
    generate.add_argument("dir", type=Path)
    run = commands.add_parser("run", help="have lab explain look at cases, and score its answers")
    run.add_argument("--jobs", type=int, default=1, help="answers asked at a time (explain uses all cores itself)")
    run.add_argument("--limit-s", type=float, default=LIMIT_S, help="longest wait for one answer [s]")
    run.add_argument("--command", default=f"{shlex.quote(_lostmotion())} lab explain", help="what is asked")
    run.add_argument("--figures", type=Path, help="folder for the picture of the confusions")
    run.add_argument("--json", action="store_true", help="one JSON document on stdout")
    for command in (generate, run):
        command.add_argument("--seed", type=int, default=0, help="0-999 to develop with, 1000 and above to report once")
        command.add_argument("--kinds", "--cases", default=",".join(KINDS), help="with commas")
        command.add_argument("--count", type=int, help=f"of each kind; {COUNTS} when left out")
    options = parser.parse_args(arguments)
    folder = options.dir if options.action == "generate" else _cache()
    cases = _written(folder, options.kinds.split(","), options.count, options.seed)
    if options.action == "generate":
        print(*cases, sep="\n")
        return
    if not cases:
        sys.exit("no cases to run")
    scores = _scored(options, cases)
    if options.figures:
        from bench.hidden_effects.figure import draw_confusion

        draw_confusion(scores, options.figures / "hidden_effects.png")
    if options.json:
        print(json.dumps(document(scores)))
    else:
        print_tables(scores, Console(width=None if sys.stdout.isatty() else 160))


def _lostmotion() -> str:
    return str(Path(sys.executable).with_name("lostmotion"))


def _cache() -> Path:
    """A folder for cases as the present generator writes them."""
    sources = b"".join(Path(__file__).with_name(f"{name}.py").read_bytes() for name in GENERATOR)
    return Path(tempfile.gettempdir()) / f"lostmotion-hidden-{hashlib.sha256(sources).hexdigest()[:12]}"


def _written(folder: Path, kinds: Sequence[str], count: int | None, seed: int) -> list[Path]:
    """The folders of the cases, those that are missing written first."""
    unknown = set(kinds) - set(KINDS)
    if unknown:
        sys.exit(f"found the kinds {', '.join(sorted(unknown))}, expected some of {', '.join(KINDS)}")
    if "joint" in kinds and not available():
        print("left out the kind joint: mujoco is not installed (pip install mujoco)", file=sys.stderr)
        kinds = [kind for kind in kinds if kind != "joint"]
    cases = [
        draw_case(kind, number, seed) for kind in kinds for number in range(COUNTS[kind] if count is None else count)
    ]
    missing = [case for case in cases if not (folder / case.name / "truth.json").exists()]
    with ProcessPoolExecutor(2) as pool:
        for case, _ in zip(missing, pool.map(write_case, missing, [folder / c.name for c in missing]), strict=True):
            print(f"wrote {case.name}", file=sys.stderr, flush=True)
    return [folder / case.name for case in cases]


def _scored(options: argparse.Namespace, folders: Sequence[Path]) -> list[Score]:
    """The scores in the order of the folders; each is printed on stderr as it comes."""
    scores = {}
    for answer in ask_all(shlex.split(options.command), folders, options.jobs, options.limit_s):
        truth = json.loads((answer.folder / "truth.json").read_text())
        name = answer.folder.name
        scores[name] = judged = score(name, truth, answer.document, answer.seconds, answer.failure)
        mark = "right" if judged.strict else "confusable" if judged.lenient else "WRONG"
        line = f"{' + '.join(judged.truth)} -> {' + '.join(judged.told) or 'none'}"
        print(f"{name:18}{mark:11}{line}; {judged.remark}; {judged.seconds:.0f} s", file=sys.stderr, flush=True)
    return [scores[folder.name] for folder in folders]


if __name__ == "__main__":
    main()
