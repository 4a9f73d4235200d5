"""A machine for a test: systemd as PID 1 in a container (systemd-nspawn), its disk a layer above the image.

The container has no network; its control group and its mounts vanish with it.  Commands enter it with nsenter.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["Machine"]

BOOT_S = 60.0
NSPAWN = (
    "systemd-nspawn", "--quiet", "--register=no", "--keep-unit", "--private-network", "--link-journal=no",
    "--console=pipe", "--system-call-filter=@memlock", "--boot",
)  # fmt: skip
"""as on a real machine, memory may be locked: Zenoh opens no session without"""


class Machine:
    """A machine whose disk is made of ``layers`` (lowest first) and, on top, a folder of its own."""

    def __init__(self, folder: Path, *layers: Path) -> None:
        self.folder = folder
        self._layers = layers
        self._cgroup = _cgroup_root() / f"lostmotion-{os.getpid()}-{folder.name}"
        self._leader = 0
        self._process: subprocess.Popen[bytes] | None = None
        for name in ("disk", "work", "root"):
            (folder / name).mkdir(parents=True)

    @property
    def disk(self) -> Path:
        """What the machine has written: a layer for another one."""
        return self.folder / "disk"

    def boot(self) -> None:
        """Starts it and waits until its systemd has done so."""
        root = self.folder / "root"
        self._cgroup.mkdir()
        script = 'echo $$ >"$1/cgroup.procs"; mount -t overlay overlay -o "$2" "$3"; shift 3; exec "$@"'
        mounted = ["unshare", "--mount", "sh", "-ec", script, "sh", self._cgroup, self._overlay(), root]
        with (self.folder / "console").open("ab") as console:
            self._process = subprocess.Popen(
                [*mounted, *NSPAWN, "-D", root], stdin=subprocess.DEVNULL, stdout=console, stderr=console,
                env=os.environ | {"SYSTEMD_NSPAWN_UNIFIED_HIERARCHY": "1"},
            )  # fmt: skip
        self.wait_until(self._is_up, BOOT_S)

    def power_off(self) -> None:
        """Shuts it down in order; its disk stays."""
        assert self._process is not None
        self.run("systemctl", "poweroff", check=False)
        try:
            self._process.wait(BOOT_S)
        finally:
            self.cut_power()

    def cut_power(self) -> None:
        """Ends everything in it at once; its disk stays."""
        if self._process is not None:
            (self._cgroup / "cgroup.kill").write_text("1")
            self._process.wait(BOOT_S)
            self._process = None
            self.wait_until(lambda: "populated 0" in (self._cgroup / "cgroup.events").read_text())
            for folder, _, _ in os.walk(self._cgroup, topdown=False):
                Path(folder).rmdir()

    def run(self, *command: str, check: bool = True) -> str:
        """Standard output of a command in the machine, standard error too where it may fail."""
        done = subprocess.run(
            [*self._enter(), *command], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
        )
        assert not check or done.returncode == 0, f"{' '.join(command)}: {done.stdout}{done.stderr}"
        return done.stdout if check else done.stdout + done.stderr

    def write(self, path: str, text: str) -> None:
        """Writes a file in it."""
        self.run("sh", "-c", f'mkdir -p "$(dirname {path})"; printf %s "$1" >{path}', "sh", text)

    def copy(self, source: Path, target: str) -> None:
        """Copies a file into it."""
        with source.open("rb") as file:
            subprocess.run([*self._enter(), "dd", "status=none", f"of={target}"], stdin=file, check=True)

    def journal(self, *arguments: str) -> list[dict[str, Any]]:
        """The service's log, oldest first."""
        return [
            json.loads(line)
            for line in self.run("journalctl", "-u", "lostmotion", "-o", "json", *arguments).splitlines()
        ]

    def said(self, text: str, *arguments: str) -> list[str]:
        """The service's messages that hold the text."""
        messages = (str(entry["MESSAGE"]) for entry in self.journal(*arguments))
        return [message for message in messages if text in message]

    def wait_until(self, condition: Callable[[], object], timeout_s: float = 90.0) -> None:
        """Waits until the condition holds; fails with the log when it never does."""
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"not within {timeout_s} s; {self._state()}"
            time.sleep(0.1)

    def write_image(self, path: Path, size: str) -> None:
        """Its whole disk as a file system image (ext4), for a virtual machine.  It must be off."""
        script = 'mount -t overlay overlay -o "$1" "$2"; mkfs.ext4 -q -F -d "$2" "$3" "$4"'
        command = ["unshare", "--mount", "sh", "-ec", script, "sh", self._overlay(), self.folder / "root", path, size]
        subprocess.run(command, check=True)

    def destroy(self) -> None:
        """Ends it and removes its disk."""
        self.cut_power()
        shutil.rmtree(self.folder)

    def _overlay(self) -> str:
        """Options that mount its disk."""
        lower = ":".join(map(str, reversed(self._layers)))
        return f"lowerdir={lower},upperdir={self.disk},workdir={self.folder / 'work'}"

    def _enter(self) -> list[str]:
        clean = ("env", "-i", "PATH=/usr/sbin:/usr/bin", "LC_ALL=C.UTF-8")
        return ["nsenter", "--target", str(self._leader), "--all", *clean]

    def _is_up(self) -> bool:
        """Whether its systemd has started everything.  Its process is the last child that systemd-nspawn makes."""
        assert self._process is not None
        assert self._process.poll() is None, self._state()
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
        self._leader = int(children[0]) if len(children) == 1 else 0
        return bool(self._leader) and self.run("systemctl", "is-system-running", check=False).strip() == "running"

    def _state(self) -> str:
        log = self.run("journalctl", "-n", "40", "-o", "short-monotonic", check=False) if self._leader else ""
        return (self.folder / "console").read_text(errors="replace") + log


def _cgroup_root() -> Path:
    """Where the unified hierarchy of control groups is mounted."""
    for line in Path("/proc/mounts").read_text().splitlines():
        _, where, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(where)
    raise AssertionError("no cgroup2 mounted")
