"""A calibration in the browser, of an emulated robot that a real service watches; and the file that it changes."""

from __future__ import annotations

import math
import re
import signal
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from lostmotion.daemon import config as configuration
from lostmotion.daemon.config import ConfigError
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.base import AccelBlock, ServoSample
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine, Taps
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.recorder import Recorder
from lostmotion.web.calibration import Calibration
from lostmotion.web.config_file import BACKUP, ConfigFile, ConfigFileError, edited
from lostmotion.web.measuring import motion
from lostmotion.web.site import Site
from tests.daemon.cli_world import SECOND_JOINT, SIMULATED
from tests.daemon.conftest import Running, start, wait_until
from tests.daemon.test_service import hardware
from tests.web.conftest import Open, Serve, overflow, violations

__all__ = ["start"]

F_RES_HZ, ZETA = 58.0, 0.012
"""of the emulator's bar"""
CLOCK = 5e-4
"""so well is the clock of a sensor known that has been heard for some seconds on a busy machine"""


def bounds(page: Page, of: str) -> tuple[float, float]:
    """The 95 % interval that the page shows."""
    found = re.search(r"95 %: ([\d.]+) to ([\d.]+)", page.locator(of).inner_text())
    assert found
    return float(found[1]), float(found[2])


@pytest.mark.slow
def test_from_the_first_tap_to_the_file_and_back(
    tmp_path: Path, serve: Serve, look: Open, start: type[Running]
) -> None:
    """Taps are counted and resonance and damping are found while the service watches the robot; the lines are shown as
    a diff, written, taken by the service, and taken back byte for byte.  On a phone; axe-core finds nothing."""
    taps = Taps(every_s=1.0)
    with Emulator(ServoLine.of("AX-12A", [1, 2], taps), CsvStream(taps)) as emulator:
        config = hardware(tmp_path, *emulator.paths)
        config.write_text("# our arm\n" + config.read_text().replace("58.0 }", "61.5 } # a guess"))
        before = config.read_bytes()
        service = start(config)
        service.wait_for("tip: reading")
        page = look(f"{serve('--config', config).address}/calibrate?joint=elbow", width=400, dark=True)
        expect(page.locator("#joint-words")).to_contain_text("f_res 61.5 Hz")
        page.locator('[data-begin="taps"]').focus()
        page.keyboard.press("Enter")
        expect(page.locator("#taps-count")).to_have_text(re.compile(r"^([5-9]|\d\d)$"))
        page.locator("#spectrum canvas").wait_for()
        page.locator('[data-end="taps"]').click()
        expect(page.locator('[data-begin="taps"]')).to_be_enabled()
        for of, truth in (("#taps-f", F_RES_HZ), ("#taps-zeta", ZETA)):
            low, high = bounds(page, of)
            # A 95 % interval misses the truth once in twenty runs, twice as wide a one once in ten thousand.
            assert truth == pytest.approx((low + high) / 2, abs=high - low + CLOCK * truth), of
            assert high - low < 0.02 * truth, of
        expect(page.locator("#diff")).to_contain_text("-oscillator = { f_res_hz = 61.5 } # a guess")
        expect(page.locator("#diff")).to_contain_text(re.compile(r"\+oscillator = .*f_res_hz = 5[78].*# a guess"))
        assert config.read_bytes() == before
        assert overflow(page) <= 0
        assert violations(page) == []
        page.locator("#write").click()
        expect(page.locator("#said")).to_contain_text("The service has taken the configuration.")
        expect(page.locator("#joint-words")).not_to_contain_text("f_res 61.5 Hz")
        service.wait_for("configuration taken")
        bar = configuration.load(config).accelerometer("tip").oscillator
        assert (bar.f_res_hz, bar.zeta) == (pytest.approx(F_RES_HZ, rel=2 * CLOCK), pytest.approx(ZETA, rel=0.02))
        assert config.read_text().startswith("# our arm\n")
        page.locator("#back summary").click()
        page.locator("#undo").click()
        expect(page.locator("#said")).to_contain_text("is as it was")
        assert config.read_bytes() == before
        assert not config.with_name(config.name + BACKUP).exists()
        service.wait_for("configuration taken", 2)
        assert service.stop(signal.SIGTERM) == 0


def without_play(folder: Path) -> Path:
    """A simulated robot, ten times as fast as real ones, with comments that a person wrote."""
    path = folder / "robot.toml"
    text = SIMULATED.replace("8e-5", "0.0  # new gears").replace('"max"', "10")
    path.write_text("# our arm\n" + text.replace("[detector]", f"{SECOND_JOINT.lstrip()}\n[detector]"))
    return path


def is_whole(calibration: Calibration) -> bool:
    """Whether nothing is missing any more."""
    found = calibration.look().motion
    return found is not None and found.missing == ()


@pytest.mark.slow
def test_from_the_motion_to_the_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no service runs the page records by itself, says what is missing, and computes window, noise and level;
    they go to the joint's own table, checked, and nothing else changes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lostmotion.web.calibration.REST", 0.5)
    config = without_play(tmp_path)
    calibration = Calibration(Site(config))
    calibration.begin("elbow", "motion", 0.1, "test")
    try:
        wait_until(lambda: is_whole(calibration), 200, lambda: str(calibration.look()))
    finally:
        calibration.end()
    found = calibration.look().motion
    assert found is not None
    assert found.windows >= found.needed == 149
    assert found.reached is not None
    assert found.wanted is not None
    assert found.reached > found.wanted
    with pytest.raises(LostmotionError, match="being calibrated"):
        calibration.forget()
    wait_until(lambda: not calibration.look().is_judging, 300)
    state = calibration.look()
    assert state.trouble == ""
    assert state.change is not None
    assert [line for line in state.change.diff if line.startswith("-") and not line.startswith("---")] == []
    calibration.write(state.change.digest, "test")
    assert calibration.look().said[-1] == "No service runs; it takes the file when it starts."
    new = configuration.load(config)
    assert new.overrides["elbow"].given()["level"] == new.settings("elbow").level != new.settings("wrist").level
    assert new.settings("elbow").noise_ms2 is not None
    assert "# new gears" in config.read_text()


def test_a_gentle_motion_is_told(tmp_path: Path) -> None:
    """What is missing is told in words: a motion that goes on, and is brisker."""
    path, settings = tmp_path / "slow.csv", DetectorSettings(F_RES_HZ, ZETA)
    robot, dice = Motion(play=0.0), np.random.default_rng(5)
    with Recorder(path, {"joint": "elbow", "rate_hz": 1000, "resolution_rad": 0.0}) as recorder:
        for times in np.split(np.arange(20_000) / 1000, 20):
            recorder.add_accel(AccelBlock(times, dice.normal(0, 2.0, times.size)))
            recorder.add_servo([ServoSample("elbow", t, 0.2 * robot.goal(t), math.nan) for t in times[::20]])
    found = motion(path, replace(settings, gentle=0.0), 0.01)
    assert found.windows > 40
    assert found.needed == 1599
    assert found.missing[0].startswith("Brisker")
    assert found.missing[1].startswith("Longer")
    assert " more of this motion." in found.missing[1]


VALUES = {"level": 5.25, "noise_colour": [0.1, -0.2], "statistic": "ringdown"}


@pytest.mark.parametrize(
    ("bar", "detector"),
    [
        ("oscillator = { f_res_hz = 61.5, length_m = 0.12 } # a guess\n", ""),
        ("oscillator.f_res_hz = 61.5 # a guess\n", "detector.level = 4.0 # old\n"),
        ("[accelerometer.oscillator] # a guess\nf_res_hz = 61.5\n", "[joint.detector] # ours\nlevel = 4.0\n"),
    ],
)
def test_lines_are_edited_and_the_others_stay(bar: str, detector: str) -> None:
    """Inline, dotted or in a table of its own: the values are set, each comment and each other line is as before."""
    text = (
        f'# arm\r\n[robot]\nname="a"   # odd   spaces\n[[accelerometer]]\nname = "tip"\n{bar}'
        f'[[joint]]\nname = "first"\naccelerometer = "tip"\n\n'
        f'[[joint]]\nname = "elbow"\naccelerometer = "tip"\n{detector}'
        "# the end\n[alarm]\nwindows = 5 # few\n"
    )
    new = edited(text, "elbow", {"f_res_hz": 58.25, "zeta": 0.0125}, VALUES)
    found = tomllib.loads(new)
    oscillator = found["accelerometer"][0]["oscillator"]
    assert (oscillator["f_res_hz"], oscillator["zeta"]) == (58.25, 0.0125)
    assert found["joint"][1]["detector"] == VALUES
    assert "detector" not in found["joint"][0]
    kept = [line for line in text.splitlines(keepends=True) if "f_res_hz" not in line and "level" not in line]
    assert [line for line in kept if line not in new] == []
    assert all(comment in new for comment in re.findall(r"# .*", text))
    assert ("zeta = 0.0125 } # a guess" in new) == ("{" in bar)


def test_only_what_was_seen_is_written(tmp_path: Path) -> None:
    """A file that changed meanwhile, or a value that the service would refuse, is left alone; rights stay."""
    path = without_play(tmp_path)
    path.chmod(0o640)
    file, old = ConfigFile(path), path.read_bytes()
    new = edited(file.text(), "elbow", {}, {"level": 5.0})
    change = file.change(new)
    assert change is not None
    path.write_bytes(old + b"# somebody was here\n")
    with pytest.raises(ConfigFileError, match="look at it again"):
        file.write(new, change.digest)
    bad = edited(file.text(), "elbow", {}, {"level": -5.0})
    seen = file.change(bad)
    assert seen is not None
    with pytest.raises(ConfigError, match="level"):
        file.write(bad, seen.digest)
    assert path.read_bytes() == old + b"# somebody was here\n"
    path.write_bytes(old)
    file.write(new, change.digest)
    assert path.stat().st_mode & 0o777 == 0o640
    assert file.backup.read_bytes() == old
    assert sorted(one.name for one in tmp_path.iterdir()) == ["robot.toml", f"robot.toml{BACKUP}"]
    back = file.change_back()
    assert back is not None
    file.take_back(back.digest)
    assert path.read_bytes() == old
