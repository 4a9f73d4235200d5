"""What a notebook shows of results."""

from __future__ import annotations

import io
import pickle
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from lostmotion.lab import experiments, read_recording
from lostmotion.lab.report.verdict import of_comparison
from lostmotion.lab.report.views import traces_of
from lostmotion.lab.results import Displayed
from lostmotion.model import build_model
from tests.lab import report_example

RESULTS: dict[str, Callable[[], Displayed]] = {
    "comparison": report_example.comparison,
    "fit": lambda: report_example.fit("coulomb_friction"),
    "explanation": report_example.explanation,
    "ladder": report_example.ladder,
}
VOID = {"br", "hr", "img"}


class Balanced(HTMLParser):
    """Whether every element that begins ends, and the rows of its tables."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.rows += tag == "tr"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.slow
@pytest.mark.parametrize("kind", RESULTS)
def test_results_show_themselves(kind: str) -> None:
    """As plain words with a table, and as a figure with two plots of each column of each recording."""
    found: Displayed = RESULTS[kind]()
    shown = Balanced(found._repr_html_())
    assert not shown.open
    assert shown.rows >= 2
    assert re.fullmatch(rf"<{type(found).__name__}: [^\[\]]+\.>", repr(found))  # sentences, no arrays
    figure = found.plot()
    assert len(figure.axes) == 2 * len(traces_of(found))
    picture = io.BytesIO()
    figure.savefig(picture, dpi=20)
    for axis in figure.axes:  # no legend is on a curve
        assert axis.get_legend().get_window_extent().y0 >= axis.get_window_extent().y1
    assert picture.getvalue().startswith(b"\x89PNG")


def test_an_estimate_by_its_name() -> None:
    """A fit gives the estimate of a parameter by its name."""
    found = report_example.fit("coulomb_friction")
    assert found["coulomb_friction.tau_c"].name == "coulomb_friction.tau_c"
    with pytest.raises(KeyError):
        found["J9"]


def test_the_phase_of_the_largest_error_is_named() -> None:
    """The phase in which the error is largest, in the words of terminal and report."""
    comparison = report_example.comparison()
    worst = comparison.worst_phase("accel").phase
    assert any(line.startswith(f"The error is largest {worst}: ") for line in of_comparison(comparison))


def test_a_recording_and_a_simulation_are_displayed_without_their_numbers(tmp_path: Path) -> None:
    """Size and columns; who asks for one that is not there gets the names of those that are."""
    model = build_model("joint")
    run = model.simulate(None, np.arange(100) * 0.01)
    assert repr(run) == "<Trajectory: 100 times, 0 to 0.99 s: torque, position, velocity, acceleration>"
    with pytest.raises(KeyError, match="no signal 'speed'; there are torque, position, velocity, acceleration"):
        run["speed"]
    path = tmp_path / "x.csv"
    path.write_text("time,torque,position\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(100)))
    recording = read_recording(path)
    assert repr(recording) == f"<Recording '{path}': 100 rows over 0.99 s of torque, position>"
    assert recording["position"][3] == 3
    assert recording["time"] is recording.time
    for asked in (recording, recording.columns, pickle.loads(pickle.dumps(recording)).columns):
        with pytest.raises(KeyError, match="no column 'angle'; there are torque, position"):
            asked["angle"]
    (experiment,) = experiments(model, [recording])
    assert repr(experiment) == f"<Experiment '{path}': 100 samples over 0.99 s of position, driven>"
    assert repr(model) == "<Model: base joint, effects: none; J = 0.0002 kg m^2, bias = 0 N m>"
