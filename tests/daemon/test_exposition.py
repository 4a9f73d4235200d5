"""The text of metrics, read by Prometheus' own parser."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from prometheus_client.parser import text_string_to_metric_families

from lostmotion.daemon.exposition import Family, text


@pytest.mark.parametrize("name", ["elbow", 'a "quoted" one', "back\\slash", "two\nlines", "Ärmel", "\\n", ""])
def test_labels_arrive_as_they_are(name: str) -> None:
    """Whatever a joint is called."""
    family = Family("score", "gauge", "Score \\ of\nthe last", ("joint", "kind")).add(1.5, name, "x")
    (found,) = text_string_to_metric_families(text([family]))
    assert found.documentation == "Score \\ of\nthe last"
    (sample,) = found.samples
    assert (sample.labels, sample.value) == ({"joint": name, "kind": "x"}, 1.5)


@pytest.mark.parametrize("value", [0.0, 1, -2.5e-300, 1e300, math.inf, -math.inf, math.nan])
def test_numbers_arrive_as_they_are(value: float) -> None:
    """To the last bit, and those that are none."""
    (found,) = text_string_to_metric_families(text([Family("score", "gauge", "Score").add(value)]))
    assert found.samples[0].value == pytest.approx(value, rel=0, abs=0, nan_ok=True)


def test_kinds_have_the_names_of_the_format() -> None:
    """Counters end in _total, what tells of the program in _info; a metric without samples is named all the same."""
    page = text(
        [Family("seen", "counter", "Seen").add(3), Family("program", "info", "It").add(1), Family("none", "gauge", "-")]
    )
    found = {family.name: family for family in text_string_to_metric_families(page)}
    assert found["seen"].type == "counter"
    assert found["seen"].samples[0].name == "seen_total"
    assert found["program_info"].samples[0].value == 1
    assert found["none"].samples == []


@pytest.mark.parametrize(
    ("module", "unwanted"),
    [("lostmotion.daemon.metrics", {"ssl", "asyncio", "http", "email"}),
     ("lostmotion.daemon.sinks.can", {"ssl", "_hashlib"})],
)  # fmt: skip
def test_sinks_bring_no_web_server_and_no_tls(module: str, unwanted: set[str]) -> None:
    """Ten megabytes of a service that has seventy; who needs TLS later in the same process gets it."""
    script = f"import sys, {module}; print(sorted({unwanted} & set(sys.modules))); import ssl, asyncio; print('TLS')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", "TLS"]
