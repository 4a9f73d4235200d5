"""The lab's page: recordings come, a model is held against them, what is missing is found and added."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from playwright.sync_api import Page, expect

from lostmotion.daemon import times
from lostmotion.daemon.cli import cli
from tests.daemon.conftest import wait_until
from tests.web.conftest import Open, Site, overflow, violations
from tests.web.world import fill, robot

RUBBING = """base = "servo"
effects = ["viscous_friction", "coulomb_friction"]
[parameters]
coulomb_friction.tau_c = 0.15
"""
MODEL = """base = "servo"
effects = ["viscous_friction"]
[parameters]
kt = { value = 1.2, fixed = true }
"""
HOSTILE = "<img src=x onerror=\"document.title='owned'\">.csv"
TINY = b"time,command,position\n0,0,0\n0.01,0.1,0.1\n0.02,0.1,0.1\n"
MOST_MB = 0.05
OWN = """open("ran", "w").write("yes")
from lostmotion.lab import Parameter, effect
@effect(acts_on="joint", parameters={"tau": Parameter(0.1, "N m", 0.0, 5.0)})
def tight_spot(omega, theta, tau):
    return -tau * omega
"""
SEARCH_MS = 240_000
"""for a search on a busy machine, and for what waits behind one"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A servo that rubs, recorded twice for two seconds; the name of the second one is hostile."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "true.toml").write_text(RUBBING)
    for seed in (1, 2):
        arguments = ("simulate", folder / "true.toml", "-o", folder / f"rec{seed}.csv",
                     "--motion", f"hand-waved:{seed}", "--duration", 2, "--rate-hz", 100,
                     "--noise", 0.0005, "--seed", seed)  # fmt: skip
        result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
        assert result.exit_code == 0, result.stderr
    return folder / "rec1.csv", (folder / "rec2.csv").rename(folder / HOSTILE)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A page whose owner allows one effect of his own, and small recordings only."""
    folder = tmp_path_factory.mktemp("lab")
    fill(folder / "history.db", count=20)
    (folder / "own.py").write_text(OWN)
    extra = f'[web]\nupload_mb = {MOST_MB}\nown_effects = ["own.py:tight_spot"]\n'
    site = Site(folder, "--config", robot(folder, extra=extra))
    yield site
    site.close()


def sent(site: Site, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
    """A change that the page's own token allows: status and document."""
    status, _, answer = site.ask("POST", path, body if body is not None else {}, x_csrf_token=site.csrf(), **headers)
    return status, json.loads(answer)


def got(site: Site, path: str) -> Any:
    """A document."""
    status, _, answer = site.ask("GET", path)
    assert status == 200, answer
    return json.loads(answer)


def asked(page: Page, *files: Path) -> None:
    """Brings the recordings and fills in the model."""
    page.locator("body[data-loaded]").wait_for()
    page.locator("#files").set_input_files([str(file) for file in files])
    expect(page.locator("#recordings :checked")).to_have_count(len(files))
    page.locator('input[name="base"][value="servo"]').check()
    page.locator("#model-details summary").click()
    page.locator("#model").fill(MODEL)


def ended(site: Site, name: str) -> Any:
    """A run when it is over."""
    wait_until(lambda: got(site, f"/api/lab/runs/{name}")["state"] != "running", 300)
    wait_until(lambda: got(site, "/api/lab")["running"] is None, 60)
    return got(site, f"/api/lab/runs/{name}")


@pytest.mark.slow
def test_from_a_recording_to_the_falling_error(site: Site, look: Open, recordings: tuple[Path, Path]) -> None:
    """Two recordings are brought, one of a hostile name; what is missing is found while the page is loaded again, told
    in words and bars, added, and then nothing is missing; model and report are taken away; axe-core finds nothing."""
    page = look(f"{site.address}/lab")
    asked(page, *recordings)
    assert violations(page) == []
    page.locator('button[value="explain"]').click()
    expect(page.locator("#going")).to_be_visible()
    address = page.url
    page.reload()
    expect(page.locator("#stop")).to_be_visible()
    page.locator("#run[data-shown]").wait_for(timeout=SEARCH_MS)
    assert page.url == address
    expect(page.locator("#words")).to_contain_text("Coulomb friction of 0.1")
    expect(page.locator("#look")).to_contain_text("dry or dirty bearing")
    first = page.locator("#ranking li").first
    expect(first).to_have_attribute("data-effect", "coulomb_friction")
    falls = [float(bar.get_attribute("width") or "nan") for bar in first.locator("rect").all()]
    expect(first.locator(".fill")).to_have_attribute("width", re.compile(r"^\d(\.\d+)?$|^1\d(\.\d+)?$"))
    assert falls[0] == 100.0
    expect(page.locator("#ladder li")).to_have_count(2)
    page.locator("#residual canvas").wait_for()
    expect(page.locator("#residual-words")).to_contain_text("After, both on one scale")
    page.locator('input[name="side"][value="before"]').check()
    expect(page.locator("#residual-words")).to_contain_text("Before, both on one scale")
    page.locator("#residual").focus()
    page.keyboard.press("+")
    assert violations(page) == []
    assert overflow(page) <= 0
    for name, begins in (("improved.toml", 'base = "servo"'), ("report.html", "<!DOCTYPE html>")):
        with page.expect_download() as download:
            page.locator(f'[data-file="{name}"]').click()
        assert download.value.path().read_text().lower().startswith(begins.lower())
    page.locator("#add-found").click()
    page.wait_for_url(re.compile(rf"/runs/(?!{address.rsplit('/', 1)[1]})"))
    page.locator("#run[data-shown]").wait_for(timeout=SEARCH_MS)
    expect(page.locator("#words")).to_contain_text("Nothing is missing")
    expect(page.locator("#ladder li")).to_have_count(2)
    expect(page.locator("#ladder li").nth(1)).to_contain_text("Added: Coulomb friction")
    assert page.locator("main img").count() == 0
    assert "owned" not in page.title()


@pytest.mark.slow
def test_where_it_fails_on_a_phone(site: Site, look: Open, recordings: tuple[Path, Path]) -> None:
    """400 pixels, dark: the error, its phases and frequencies, and the torque that seems to be missing; nothing
    overflows, axe-core finds nothing; the page's process has loaded neither SciPy nor numba."""
    page = look(f"{site.address}/lab", width=400, dark=True)
    asked(page, recordings[0])
    assert overflow(page) <= 0
    assert violations(page) == []
    page.locator('button[value="compare"]').click()
    page.locator("#run[data-shown]").wait_for(timeout=SEARCH_MS)
    expect(page.locator("#words")).to_contain_text("The error in angle is 0.5")
    expect(page.locator("#phases")).to_contain_text("before a reversal")
    expect(page.locator("#missing-words")).to_contain_text(
        re.compile(r"Dry friction of about 0\.1[567] N m is missing")
    )
    for plot in ("residual", "overlay", "shape"):
        page.locator(f"#{plot} canvas").wait_for()
    assert overflow(page) <= 0
    assert violations(page) == []
    maps = Path(f"/proc/{site.process.pid}/maps").read_text()
    assert "numpy" in maps
    assert "/scipy/" not in maps
    assert "llvmlite" not in maps


@pytest.mark.slow
def test_a_run_is_stopped_and_another_one_waits(site: Site, look: Open, recordings: tuple[Path, Path]) -> None:
    """A second run is refused in words; Stop in the page ends the first."""
    page = look(f"{site.address}/lab", complains=True)
    asked(page, recordings[0])
    page.locator('button[value="explain"]').click()
    page.wait_for_url("**/lab/runs/*")
    expect(page.locator("#stop")).to_be_visible()
    first = page.url
    name = got(site, "/api/lab")["recordings"][0]["name"]
    status, answer = sent(site, "/api/lab/runs", {"kind": "compare", "recordings": [name], "model": MODEL})
    assert (status, "wait until it ends" in answer["error"]) == (409, True)
    page.goto(f"{site.address}/lab")
    expect(page.locator("#running-link")).to_have_attribute("href", first.removeprefix(site.address))
    page.goto(first)
    page.locator("#stop").click()
    expect(page.locator("#trouble")).to_have_text("It was stopped.")
    expect(page.locator("#going")).to_be_hidden()
    page.locator("#remove").click()
    page.wait_for_url("**/lab")
    assert first.rsplit("/", 1)[1] not in [run["id"] for run in got(site, "/api/lab")["runs"]]


@pytest.mark.slow
def test_a_recording_that_is_too_large_is_refused(site: Site, look: Open, tmp_path: Path) -> None:
    """By the page before it is sent, by the server where it is sent all the same."""
    large = tmp_path / "large.csv"
    large.write_bytes(TINY + b"0.03,0.1,0.1\n" * 10_000)
    page = look(f"{site.address}/lab")
    page.locator("body[data-loaded]").wait_for()
    page.locator("#files").set_input_files(str(large))
    expect(page.locator("#files-answer")).to_contain_text("50.0 kB at most")
    before = got(site, "/api/lab")["recordings"]
    token = site.csrf()
    status, _, answer = site.ask("POST", "/api/lab/recordings?name=a.csv", large.read_bytes(), x_csrf_token=token)
    assert (status, b"more than 0.05 MB" in answer) == (413, True)
    assert got(site, "/api/lab")["recordings"] == before


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../../etc/passwd", "passwd.csv"),
        ("..%5C..%5Cx.csv", "x.csv"),
        (".hidden.csv", "hidden.csv"),
        ("-rf.csv", "rf.csv"),
        ("%00", "recording.csv"),
        ("a" * 300 + ".csv", "a" * 50 + ".csv"),
        ("%3Cscript%3E.csv", "script.csv"),
    ],
)
def test_a_name_from_outside_stays_in_its_folder(site: Site, name: str, kept: str) -> None:
    """Whatever a file is called, it lies among the recordings by a harmless name, by which it is found."""
    status, answer = sent(site, f"/api/lab/recordings?name={name}", TINY)
    assert (status, answer["name"], answer["columns"]) == (201, kept, ["command", "position"])
    status, headers, body = site.ask("GET", f"/api/lab/recordings/{kept}")
    assert (status, body) == (200, TINY)
    assert "attachment" in headers["content-disposition"]
    assert sent(site, f"/api/lab/recordings/{kept}/remove")[0] == 200
    assert site.ask("GET", f"/api/lab/recordings/{kept}")[0] == 404


@pytest.mark.parametrize("body", [b"", b"\x7fELF\x00\x01", b"import os"])
def test_what_is_no_recording_is_refused(site: Site, body: bytes) -> None:
    """In one sentence, and nothing is kept."""
    before = got(site, "/api/lab")["recordings"]
    status, answer = sent(site, "/api/lab/recordings?name=x.csv", body)
    assert status == 422
    assert "expected a recording" in answer["error"]
    assert got(site, "/api/lab")["recordings"] == before


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"model": 'base = "servo"\neffects = ["/tmp/evil.py:f"]'}, 422, "only web.own_effects"),
        ({"model": 'base = "servo"\neffects = ["../../../own.py:other"]'}, 422, "only web.own_effects"),
        ({"model": 'base = "servo"\neffects = ["own.py"]'}, 422, "only web.own_effects"),
        ({"model": 'base = "../x"'}, 422, "expected one of"),
        ({"model": "base ="}, 422, "no TOML"),
        ({"model": 'base = "servo"\neffects = [[1]]'}, 422, "no list of names"),
        ({"recordings": ["../history.db"]}, 404, "no recording"),
        ({"recordings": []}, 422, "recordings"),
        ({"own": ["evil"]}, 422, "no effect of the owner's"),
        ({"kind": "rm"}, 422, "kind"),
    ],
)
def test_what_a_browser_may_not_ask_is_refused(site: Site, change: dict[str, Any], status: int, words: str) -> None:
    """In one sentence; no file is run, no folder of a run is left."""
    sent(site, "/api/lab/recordings?name=tiny.csv", TINY)
    name = got(site, "/api/lab")["recordings"][0]["name"]
    runs = got(site, "/api/lab")["runs"]
    found, answer = sent(site, "/api/lab/runs", {"kind": "compare", "recordings": [name], "model": MODEL} | change)
    assert (found, words in answer["error"]) == (status, True), answer
    assert got(site, "/api/lab")["runs"] == runs
    assert sent(site, f"/api/lab/recordings/{name}/remove")[0] == 200


@pytest.mark.slow
def test_a_file_of_another_program_becomes_a_recording(site: Site, look: Open, tmp_path: Path) -> None:
    """PlotJuggler's names are told with what was taken for them, and the recording is chosen in the lab; what no reader
    understands is said."""
    file = tmp_path / "run <b>7.csv"
    rows = "".join(f"{1.7e9 + k / 100:.2f},{k / 1000},{k / 1000}\n" for k in range(60))
    file.write_text(f"__time,/joint_states/elbow/position,/cmd/elbow\n{rows}")
    page = look(f"{site.address}/lab")
    page.locator("body[data-loaded]").wait_for()
    page.locator("#files").set_input_files(str(file))
    page.locator("#run[data-shown]").wait_for(timeout=SEARCH_MS)
    expect(page.locator("#words")).to_contain_text("60 rows over 0.59 s out of PlotJuggler CSV")
    expect(page.locator("#words")).to_contain_text("Position is /joint_states/elbow/position")
    page.locator("#again").click()
    expect(page.locator("#recordings :checked")).to_have_value("run_b_7.csv")
    wait_until(lambda: got(site, "/api/lab")["running"] is None, 60)
    status, answer = sent(site, "/api/lab/recordings?name=x.csv", b"import os\nos.system('touch ran')\n")
    assert status == 202
    job = ended(site, answer["run"])
    assert job["state"] == "failed"
    assert job["text"].startswith("given-x.csv: ")


@pytest.mark.slow
def test_several_files_of_another_program_become_recordings(site: Site, look: Open, tmp_path: Path) -> None:
    """One after another, as one run is under way at a time: all are chosen, and what is wrong with one is told."""
    files = [tmp_path / f"swing{at}.csv" for at in (1, 2, 3)]
    rows = "".join(f"{10 * k},{k / 10}\n" for k in range(60))
    for file in files:
        file.write_text(f"t_ms,angle_deg\n{rows}")
    files[1].write_text("nothing to read\n")
    page = look(f"{site.address}/lab")
    page.locator("body[data-loaded]").wait_for()
    page.locator("#files").set_input_files(list(map(str, files)))
    expect(page.locator("#recordings :checked")).to_have_count(2, timeout=SEARCH_MS)
    expect(page.locator("#files-answer")).to_contain_text("swing2.csv: ")
    for name in ("swing1.csv", "swing3.csv"):
        expect(page.locator(f'#recordings input[value="{name}"]')).to_be_checked()


@pytest.mark.slow
def test_an_effect_of_the_owners_is_offered_and_runs(site: Site) -> None:
    """The page lists it; a model may name it; a run with it runs its file, where the recordings are."""
    assert b'value="tight_spot"' in site.ask("GET", "/lab")[2]
    rows = "".join(f"{k / 100},{k / 1000},{k / 1000}\n" for k in range(60))
    name = sent(site, "/api/lab/recordings?name=short.csv", f"time,command,position\n{rows}".encode())[1]["name"]
    own = 'base = "servo"\neffects = ["../../../own.py:tight_spot"]\n'
    status, answer = sent(site, "/api/lab/runs", {"kind": "compare", "recordings": [name], "model": own})
    assert status == 201, answer
    job = ended(site, answer["id"])
    assert job["about"]["effects"] == ["tight_spot"]
    assert (site.folder / "lab" / "recordings" / "ran").read_text() == "yes"
    assert job["state"] == "done", job["text"]


@pytest.mark.slow
def test_what_the_lab_says_of_a_bad_recording_is_shown(site: Site, look: Open) -> None:
    """One sentence with the recording's name, no path of this computer."""
    name = sent(site, "/api/lab/recordings?name=bad.csv", b"time,command,position\n0,1,x\n1,2,3\n")[1]["name"]
    status, answer = sent(site, "/api/lab/runs", {"kind": "compare", "recordings": [name], "model": MODEL})
    assert status == 201
    page = look(f"{site.address}/lab/runs/{answer['id']}")
    expect(page.locator("#trouble")).to_contain_text(f"{name}: line 2", timeout=SEARCH_MS)
    assert str(site.folder) not in page.inner_text("main")


@pytest.mark.parametrize(
    "path",
    ["/api/lab/runs/..", "/api/lab/runs/20260101T000000-abcdef", "/lab/runs/x", "/api/lab/runs/x/files/wish.json"],
)
def test_there_is_nothing_elsewhere(site: Site, path: str) -> None:
    """A status of 404 and a sentence."""
    assert site.ask("GET", path)[0] == 404


def test_without_the_token_nothing_changes(site: Site) -> None:
    """Uploads, runs, stops and removals need it."""
    for path in (
        "recordings?name=x.csv",
        "recordings/x.csv/remove",
        "runs",
        "runs/x/stop",
        "runs/x/add",
        "runs/x/remove",
    ):
        assert site.ask("POST", f"/api/lab/{path}", TINY)[0] == 403, path


@pytest.mark.slow
def test_a_length_of_time_is_told_alike(site: Site, look: Open) -> None:
    """The script of the lab's pages and ``times.span`` have the same words for every time that a run may take."""
    seconds = [0, 1, 59, 119, 120, 200, 899, 900, 5000, 7199, 7200, 30_000, 172_799]
    page = look(f"{site.address}/lab")
    script = "async (all) => { const { duration } = await import('/static/labshared.js'); return all.map(duration); }"
    assert page.evaluate(script, seconds) == [times.span(one) for one in seconds]
