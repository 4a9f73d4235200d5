"""The files that make lostmotion a systemd service: their text, their places, and whether its user can read them.

Nothing here changes the system; ``commands/service.py`` does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import lostmotion
from lostmotion.drivers.errors import LostmotionError

__all__ = ["PAGE_UNIT", "STATE", "UNIT", "Layout", "ServiceError", "check_reachable", "template", "unit_text"]

UNIT = "lostmotion.service"
PAGE_UNIT = "lostmotion-web.service"
STATE = Path("/var/lib/lostmotion")
FOLDER = Path(lostmotion.__file__).parent / "systemd"
DOCS = Path(lostmotion.__file__).resolve().parent / "docs"
HIDDEN = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))
"""what ProtectHome and PrivateTmp hide from the service"""
READ, ENTER = 0o004, 0o001
"""permission bits for others: of a file, of a folder"""
SINCE = {"RestartSteps": 254, "RestartMaxDelaySec": 254}
"""settings that an older systemd would complain about, and the version that brought them"""


class ServiceError(LostmotionError):
    """The service cannot be installed, started or removed; the one-line message has the cause and the remedy."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where everything goes below ``root``."""

    root: Path

    @property
    def unit(self) -> Path:
        return self.root / "etc/systemd/system" / UNIT

    @property
    def page(self) -> Path:
        return self.unit.with_name(PAGE_UNIT)

    @property
    def rules(self) -> Path:
        return self.root / "etc/udev/rules.d/70-lostmotion.rules"

    @property
    def config(self) -> Path:
        return self.root / "etc/lostmotion/lostmotion.toml"

    @property
    def state(self) -> tuple[Path, ...]:
        """The data's folder as people name it, and where DynamicUser really keeps it."""
        return self.root / "var/lib/lostmotion", self.root / "var/lib/private/lostmotion"


def template(name: str) -> str:
    """The text of a file that ships with lostmotion."""
    return (FOLDER / name).read_text(encoding="utf-8")


def unit_text(command: Path, systemd: int, name: str = UNIT) -> str:
    """A unit for the installed ``command``, with what that version of systemd knows."""
    word = re.sub(r'(["\\])', r"\\\1", str(command)).replace("%", "%%").replace("$", "$$")
    filled = template(name).replace("@COMMAND@", f'"{word}"' if re.search(r"\s|[\"'\\]", word) else word)
    lines = filled.replace("@DOCS@", DOCS.as_uri().replace("%", "%%")).splitlines()
    known = (line for line in lines if SINCE.get(line.partition("=")[0], 0) <= systemd)
    return "".join(f"{line}\n" for line in known)


def check_reachable(places: Iterable[Path]) -> None:
    """Raises ServiceError for a file of the program that the service's own user could not see or read."""
    for place in places:
        for folder in HIDDEN:
            if place.is_relative_to(folder):
                raise ServiceError(
                    f"{place}: found the program below {folder}, which is hidden from the service; expected it where "
                    "all may read: python3 -m venv /opt/lostmotion && /opt/lostmotion/bin/pip install ."
                )
        for part, needed in ((place, READ), *((parent, ENTER) for parent in place.parents)):
            if not part.stat().st_mode & needed:
                raise ServiceError(
                    f"{part}: found closed to other users, expected it open to the service's own; was it installed "
                    f"with a strict umask? chmod -R a+rX {part}"
                )
