"""The detector settings of a command on a recording: its options, and which source takes precedence."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lostmotion.daemon import config as configuration
from lostmotion.detector.window import LEVELS, ZETA, DetectorSettings, Statistic
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.recording import Recording

__all__ = ["OptionsError", "ScoringOptions", "settings_for"]

KEYS_OF_SETTINGS = ("f_res_hz", "zeta", "level", "statistic")
F_RES_HZ, LENGTH_M = 58.0, 0.10
"""The bar when none is given: the default oscillator, as in the built-in configuration."""


class OptionsError(LostmotionError):
    """The options do not determine the settings."""


@dataclass(frozen=True, slots=True)
class ScoringOptions:
    """The options of the command line; None for those not given."""

    joint: str | None = None
    column: str = "accel"
    f_res_hz: float | None = None
    zeta: float | None = None
    level: float | None = None
    statistic: Statistic | None = None


def settings_for(recording: Recording, config: Path | None, options: ScoringOptions) -> DetectorSettings:
    """Options before configuration before the recording's head before defaults.  Raises LostmotionError."""
    if config:
        settings = _of_config(config, options.joint or recording.metadata.get("joint"))
    else:
        f_res_hz, zeta = recording.number("f_res_hz", F_RES_HZ), recording.number("zeta", ZETA)
        settings = DetectorSettings(f_res_hz=f_res_hz, zeta=zeta, length_m=recording.number("length_m", LENGTH_M))
    given = {key: value for key, value in asdict(options).items() if key in KEYS_OF_SETTINGS and value is not None}
    if options.statistic not in (None, settings.statistic):
        given.setdefault("level", LEVELS[options.statistic])
    return replace(settings, **given)


def _of_config(path: Path, joint: Any) -> DetectorSettings:
    config = configuration.load(path)
    names = [row.name for row in config.joints]
    if joint is None and len(names) > 1:
        raise OptionsError(
            f"{path}: found {len(names)} joints, expected one; choose with --joint from {', '.join(names)}"
        )
    return config.settings(names[0] if joint is None else str(joint))
