"""The lab's page: recordings to choose and to upload, runs that compare and explain, what they have found.

The lab itself runs in processes of its own (``jobs.py``), by the command line: nothing heavy is imported here.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Route

from lostmotion.daemon.database import is_held
from lostmotion.drivers.formats.registry import is_foreign
from lostmotion.web.bodies import document
from lostmotion.web.jobs import Job, JobError, Jobs
from lostmotion.web.lab_models import BASES, ModelRefusedError, head, own_effects
from lostmotion.web.pages import json, page, site_of
from lostmotion.web.recordings import Shelf, harmless
from lostmotion.web.site import Site

__all__ = ["LONGEST_S", "PROGRAM", "ROUTES", "Lab", "lab_of"]

PROGRAM = (sys.executable, "-P", "-c", "from lostmotion.daemon.cli import main; main()")
BUDGET = "60s"
MOST_RECORDINGS = 20
MOST_MODEL = 100_000
MOST_BODY = 2 * MOST_MODEL
LONGEST_S = 600
"""of a recording that is made here [s]"""
LOOK_S, BEAT_S = 0.25, 15.0
FILES = {
    "result.json": "application/json",
    "curves.json": "application/json",
    "report.html": "text/html",
    "model.toml": "application/toml",
    "improved.toml": "application/toml",
}
"""what a run leaves for a browser; only JSON is shown in it, the rest is for taking away"""
LONGEST_TEXT = 200
Name = Annotated[str, Meta(max_length=LONGEST_TEXT)]


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request for a run; model: the text of a model file; own: of the owner's effects, those to try."""

    kind: Literal["compare", "explain"]
    recordings: Annotated[list[Name], Meta(min_length=1, max_length=MOST_RECORDINGS)]
    model: Annotated[str, Meta(max_length=MOST_MODEL)]
    own: list[Name] = []


class Added(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which effects are to be added to the model of a run."""

    effects: Annotated[list[Name], Meta(min_length=1, max_length=10)]


class Lab:
    """The lab of a robot: its recordings, its runs, its owner's effects."""

    def __init__(self, site: Site) -> None:
        options, folder = site.config().web, site.lab_folder
        self.shelf = Shelf(folder / "recordings", int(options.upload_mb * 1e6))
        self.jobs = Jobs(folder / "runs")
        here = site.config_file.parent if site.config_file else Path()
        self.own = own_effects(options.own_effects, here)

    def begin(self, asked: Asked) -> str:
        """Begins a run; its id."""
        if unknown := [name for name in asked.own if name not in self.own]:
            raise ModelRefusedError(f"no effect of the owner's is called {unknown[0]!r}")
        for name in asked.recordings:
            self.shelf.path(name)
        folder = self.jobs.new()
        try:
            model = head(asked.model, folder, self.own)
        except ModelRefusedError:
            folder.rmdir()
            raise
        (folder / "model.toml").write_text(asked.model, "utf-8")
        about = {"kind": asked.kind, "recordings": asked.recordings, "base": model.base, "effects": model.effects,
                 "own": asked.own, "rungs": [], "added": []}  # fmt: skip
        return self._start(folder, (), about)

    def add(self, name: str, effects: Sequence[str]) -> str:
        """Begins a run that explains what the model of another run lacks when it has these effects, too; its id."""
        parent = self.jobs.find(name)
        if parent.state != "done" or parent.about["kind"] != "explain":
            raise HTTPException(409, "only a run that has explained can go on")
        found = msgspec.json.decode(self.jobs.path(name, "result.json").read_bytes())
        has = parent.about["effects"]
        if unknown := [effect for effect in effects if effect not in found["names"] or effect in has]:
            raise HTTPException(422, f"found the effect {unknown[0]!r}, expected one that was tried and is not there")
        for recording in parent.about["recordings"]:
            self.shelf.path(recording)
        folder = self.jobs.new()
        steps: list[list[str]] = []
        if set(effects) == set(found["missing"]):
            shutil.copy(self.jobs.path(name, "improved.toml"), folder / "model.toml")
        else:
            model = str(self.jobs.path(name, "model.toml"))
            for effect in effects:
                steps.append([*PROGRAM, "lab", "add", model, self.own.get(effect, effect), "-o",
                              str(folder / "model.toml"), "--json"])  # fmt: skip
                model = str(folder / "model.toml")
        error = found["error"]
        rung = {"run": name, "effects": has, "added": parent.about["added"], "rms": error["before"],
                "noise": error["noise"], "unit": error["unit"]}  # fmt: skip
        about = parent.about | {"effects": [*has, *effects], "rungs": [*parent.about["rungs"], rung], "added": effects,
                                "names": found["names"]}  # fmt: skip
        return self._start(folder, steps, about)

    def import_file(self, part: Path, name: str, joint: str) -> str:
        """Begins a run that makes a recording of another program's file; its id."""
        folder = self.jobs.new()
        file = part.rename(folder / f"given-{harmless(name)}")
        kept = self.shelf.free(Path(name).stem)
        command = [*PROGRAM, "import", str(file), "-o", str(self.shelf.folder / kept), "--joint", joint, "--json"]
        return self.jobs.start(
            folder, [command], self.shelf.folder, {"kind": "import", "recordings": [kept], "file": harmless(name)}
        )

    def _start(self, folder: Path, steps: Sequence[list[str]], about: dict[str, Any]) -> str:
        """Begins; in the folder of the recordings, whose names are then what the reports call them."""
        verb = "compare" if about["kind"] == "compare" else "improve"
        last = [*PROGRAM, "lab", verb, str(folder / "model.toml"), *about["recordings"], "--json",
                "--curves", str(folder / "curves.json"), "--report", str(folder / "report.html")]  # fmt: skip
        if verb == "improve":
            last += ["-o", str(folder / "improved.toml"), "--progress", "json", "--budget", BUDGET,
                     "--executor", f"threads:{max((os.cpu_count() or 1) - 1, 1)}"]  # fmt: skip
            last += [
                part for own in about["own"] if own not in about["effects"] for part in ("--effect", self.own[own])
            ]
        return self.jobs.start(folder, [*steps, last], self.shelf.folder, about)


def show(request: Request) -> Response:
    """The page with the choice of recordings and models."""
    lab = lab_of(request)
    site = site_of(request)
    return page(
        request, "lab.html", title="Lab", bases=BASES, own=sorted(lab.own), most=lab.shelf.largest, longest=LONGEST_S,
        joints=[joint.name for joint in site.config().joints], is_watched=bool(is_held(site.database)),
    )  # fmt: skip


def show_run(request: Request) -> Response:
    """The page of one run."""
    job = _job(request)
    return page(request, "run.html", title="Run of the lab", job=job, kind=job.about["kind"])


def overview(request: Request) -> Response:
    """The recordings, and all runs."""
    lab = lab_of(request)
    running = lab.jobs.running()
    return json(
        {"recordings": lab.shelf.all(), "runs": lab.jobs.all(), "running": running[0] if running else None,
         "own": sorted(lab.own)}
    )  # fmt: skip


async def upload(request: Request) -> Response:
    """Keeps a recording, which is the body; ``name``: what its file is called where it comes from.  A file of another
    program becomes a recording by a run; ``joint``: which one, where it has several."""
    lab, length = lab_of(request), request.headers.get("content-length", "")
    name, joint = (request.query_params.get(key, "")[:LONGEST_TEXT] for key in ("name", "joint"))
    part = await lab.shelf.receive(int(length) if length.isdecimal() else None, request.stream())
    try:
        if is_foreign(part):
            return json({"run": await run_in_threadpool(lab.import_file, part, name, joint)}, 202)
        return json(lab.shelf.keep(part, name), 201)
    finally:
        part.unlink(missing_ok=True)


def recording(request: Request) -> Response:
    """A recording, to take away."""
    path = lab_of(request).shelf.path(request.path_params["name"])
    return FileResponse(path, media_type="text/csv", filename=path.name)


def remove_recording(request: Request) -> Response:
    """Deletes one."""
    lab_of(request).shelf.remove(request.path_params["name"])
    return json({"removed": True})


async def begin(request: Request) -> Response:
    """Begins a run."""
    asked = await document(request, Asked, MOST_BODY)
    return json({"id": await run_in_threadpool(lab_of(request).begin, asked)}, 201)


async def add(request: Request) -> Response:
    """Begins a run with more effects than this one had."""
    asked = await document(request, Added)
    return json({"id": await run_in_threadpool(lab_of(request).add, request.path_params["id"], asked.effects)}, 201)


def run(request: Request) -> Response:
    """A run as it is now."""
    return json(_job(request))


def stop(request: Request) -> Response:
    """Ends a run."""
    job = _job(request)
    lab_of(request).jobs.stop(job.id)
    return json(_job(request))


def remove(request: Request) -> Response:
    """Forgets a run."""
    lab_of(request).jobs.remove(_job(request).id)
    return json({"removed": True})


def file(request: Request) -> Response:
    """What a run has left."""
    name = request.path_params["file"]
    if name not in FILES:
        raise HTTPException(404, f"a run leaves no {name[:40]!r}")
    job = _job(request)
    path = lab_of(request).jobs.path(job.id, name)
    as_file = None if name.endswith(".json") and "download" not in request.query_params else f"{job.id}-{name}"
    return FileResponse(path, media_type=FILES[name], filename=as_file)


async def events(request: Request) -> Response:
    """How a run goes on, until it ends."""
    job = _job(request)
    headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
    return StreamingResponse(_news(lab_of(request).jobs, job.id), media_type="text/event-stream", headers=headers)


async def _news(jobs: Jobs, name: str) -> AsyncIterator[bytes]:
    yield b"retry: 2000\n\n"
    sent: object = None
    waited = 0.0
    while True:
        if (stamp := jobs.stamp(name)) != sent:
            sent, waited = stamp, 0.0
            try:
                job = jobs.find(name)
            except JobError:
                return
            yield f"event: run\ndata: {msgspec.json.encode(job).decode()}\n\n".encode()
            if job.state != "running":
                return
        elif waited >= BEAT_S:
            waited = 0.0
            yield b": still\n\n"
        await asyncio.sleep(LOOK_S)
        waited += LOOK_S


def lab_of(request: Request) -> Lab:
    """The lab; made when somebody first looks, and again when the configuration has changed."""
    site, state = site_of(request), request.app.state
    config = site.config()
    if getattr(state, "lab_of", None) is not config:
        state.lab, state.lab_of = Lab(site), config
    lab: Lab = state.lab
    return lab


def _job(request: Request) -> Job:
    return lab_of(request).jobs.find(request.path_params["id"])


ROUTES = [
    Route("/lab", show),
    Route("/lab/runs/{id}", show_run),
    Route("/api/lab", overview),
    Route("/api/lab/recordings", upload, methods=["POST"]),
    Route("/api/lab/recordings/{name}", recording),
    Route("/api/lab/recordings/{name}/remove", remove_recording, methods=["POST"]),
    Route("/api/lab/runs", begin, methods=["POST"]),
    Route("/api/lab/runs/{id}", run),
    Route("/api/lab/runs/{id}/add", add, methods=["POST"]),
    Route("/api/lab/runs/{id}/stop", stop, methods=["POST"]),
    Route("/api/lab/runs/{id}/remove", remove, methods=["POST"]),
    Route("/api/lab/runs/{id}/events", events),
    Route("/api/lab/runs/{id}/files/{file}", file),
]
