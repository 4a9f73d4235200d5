"""The machine's root image: Debian packages from this machine's own apt sources, and a virtual environment with what
lostmotion needs (its wheel comes later).  Built once, kept in a folder outside of the tree.

LOSTMOTION_IMAGES names that folder; by default it is in the user's cache (XDG base directory specification).
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.conftest import ROOT

__all__ = ["PACKAGES", "VENV", "image", "missing"]

PACKAGES = ("systemd", "udev", "libnss-systemd", "python3-venv")
VENV = "/opt/lostmotion"
TOOLS = ("mmdebstrap", "systemd-nspawn", "unshare", "nsenter", "apt-get")


def missing() -> str:
    """Why no machine can be started here; "" when one can."""
    if os.geteuid() != 0:
        return "root is needed for containers"
    gone = [tool for tool in TOOLS if shutil.which(tool) is None]
    if gone:
        return f"{', '.join(gone)} missing; apt-get install systemd-container mmdebstrap"
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode:
        return "mounts are not allowed here; is this a container without privileges?"
    return "" if "cgroup2" in Path("/proc/mounts").read_text() else "no cgroup2 is mounted"


def image(kind: str = "container", extra: tuple[str, ...] = ()) -> Path:
    """The folder of the image of that kind, with extra Debian packages, built if it is not there."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = Path(os.environ.get("LOSTMOTION_IMAGES") or cache / "lostmotion" / "images")
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder / "lock"):
        root = folder / f"{kind}-{_fingerprint(extra)}"
        if not root.exists():
            for old in folder.glob(f"{kind}-*"):
                shutil.rmtree(old)
            _build(folder, root, extra)
    return root


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """One builder at a time: the tests may run in several processes."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _fingerprint(extra: tuple[str, ...]) -> str:
    """Changes when the image would."""
    parts = [Path(__file__).read_text(), *extra, *_dependencies(), _suite(), platform.machine()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


def _dependencies() -> list[str]:
    return list(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"])


def _suite() -> str:
    return platform.freedesktop_os_release()["VERSION_CODENAME"]


def _build(folder: Path, root: Path, extra: tuple[str, ...]) -> None:
    """The image appears under its name only when it is whole."""
    new = folder / "new"
    shutil.rmtree(new, ignore_errors=True)
    include = f"--include={','.join(PACKAGES + extra)}"
    _run("mmdebstrap", "--quiet", "--variant=minbase", include, _suite(), new, *_sources())
    version = _run("chroot", new, "python3", "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip()
    wheels = new / "wheels"
    pip = (sys.executable, "-m", "pip", "--quiet")
    _run(*pip, "download", "--only-binary=:all:", "--python-version", version, "--dest", wheels, *_dependencies())
    _run("chroot", new, "python3", "-m", "venv", VENV)
    offline = ("--no-index", "--no-compile", "--find-links=/wheels")  # most modules are never used
    _run("chroot", new, f"{VENV}/bin/pip", "install", *offline, *_dependencies())
    shutil.rmtree(wheels)
    new.rename(root)


def _sources() -> list[str]:
    """The sources of Debian's own packages that this machine's apt is set up with, as one-line entries."""
    form = "deb $(REPO_URI) $(RELEASE) $(COMPONENT)"
    told = _run("apt-get", "indextargets", "--format", form, "Created-By: Packages", "Origin: Debian")
    return sorted(set(told.splitlines()))


def _run(*command: str | Path) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run([str(part) for part in command], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 0, f"{command[0]}: {done.stderr[-2000:]}"
    return done.stdout
