"""The fleet's page: several robots on one router, one of which does not answer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import zenoh
from playwright.sync_api import expect

from lostmotion.daemon.commands.fleet_ask import Fleet, FleetReply
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import Health, JointRow, ScoreRow
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.store import Store
from lostmotion.web.fleet import SILENT, Watch, view
from tests.daemon.conftest import free_endpoint, wait_until
from tests.daemon.zenoh_world import session
from tests.web.conftest import Open, Serve, overflow, violations
from tests.web.world import HOSTILE, fill, robot

NOW = datetime(2026, 6, 1, tzinfo=UTC)


def healthy(path: Path, name: str) -> None:
    """The database of a robot with a joint that is well."""
    store = Store(path, name)
    store.add(ScoreRow("knee", datetime.now(UTC), 0.25, 1.5, 4.0, False))
    store.add(JointRow("knee", Health.OK, "", datetime.now(UTC)))
    store.close()


@pytest.fixture
def network(tmp_path: Path) -> Iterator[tuple[str, zenoh.LivelinessToken]]:
    """A router; a healthy robot ``arm0`` and a worn one with a hostile name answer, ``mute`` lives and does not."""
    endpoint = free_endpoint()
    healthy(tmp_path / "arm0.db", "arm0")
    fill(tmp_path / "history.db", count=40, name=HOSTILE)
    with ExitStack() as stack:
        router = stack.enter_context(session("router", listen=[endpoint]))
        options = ZenohOptions(mode="client", connect=[endpoint])
        for name, database in (("arm0", "arm0.db"), (HOSTILE, "history.db")):
            sink = stack.enter_context(closing(ZenohSink(name, options, tmp_path / database)))
            wait_until(lambda sink=sink: sink.is_open)
        token = router.liveliness().declare_token("lostmotion/mute/alive")
        yield endpoint, token


@pytest.mark.slow
def test_worst_first_and_the_silent_named(
    tmp_path: Path,
    serve: Serve,
    look: Open,
    network: tuple[str, zenoh.LivelinessToken],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The worn robot stands before the healthy one, its name is text; who is alive or expected and silent is named, and
    stays named when it is alive no more.  Axe-core finds nothing at the width of a phone."""
    endpoint, token = network
    site = serve("--config", robot(tmp_path), "--connect", endpoint, "--robots", "arm9")
    page = look(f"{site.address}/fleet", width=400, dark=True)
    cards = page.locator("#robots > .card")
    expect(cards).to_have_count(2)
    expect(cards.nth(0).locator("h3")).to_contain_text(HOSTILE)
    expect(cards.nth(0)).to_contain_text("play warning (active)")
    expect(cards.nth(1)).to_contain_text("score 1.5")
    expect(page.locator("#missing")).to_contain_text("arm9: did not answer")
    expect(page.locator("#missing")).to_contain_text("mute: did not answer")
    assert page.locator("main img").count() == 0
    assert "owned" not in page.title()
    assert overflow(page) <= 0
    assert violations(page) == []
    watch = Watch(Fleet([endpoint], timeout_s=1.0))
    assert watch.look().missing == (("mute", SILENT),)
    token.undeclare()
    monkeypatch.setattr("lostmotion.web.fleet.REST_S", 0.0)
    assert watch.look().missing == (("mute", SILENT),)


def test_one_robot_has_no_fleet(tmp_path: Path, serve: Serve) -> None:
    """Without --connect no page leads to the fleet, and its address says what is missing."""
    fill(tmp_path / "history.db", count=20)
    site = serve("--config", robot(tmp_path))
    assert b'href="/fleet"' not in site.ask("GET", "/")[2]
    status, _, body = site.ask("GET", "/fleet", accept="text/html")
    assert status == 404
    assert b"--connect" in body


def joint(name: str, health: str, score: float | None) -> dict[str, Any]:
    """A joint of a status document."""
    return {"name": name, "health": health, "score": score, "level": 4.0, "alarms": []}


def test_order_and_foreign_documents() -> None:
    """Health decides before the score, the score before the name; what is no status is named as missing."""
    documents = [
        ("calm", {"joints": [joint("a", "OK", 3.9), joint("b", "OK", None)]}),
        ("worn", {"joints": [joint("a", "OK", 3.0), joint("b", "WARNING", 4.1)]}),
        ("shaken", {"joints": [joint("a", "WARNING", 9.0)]}),
        ("odd", {"joints": [{"name": 7}]}),
        ("none", {}),
    ]
    found = view(FleetReply(documents, {"twin": "2 robots answer to this name"}, ["mute"], {"tcp/h:1": "refused"}), NOW)
    assert [one.robot for one in found.robots] == ["shaken", "worn", "calm"]
    assert [one.joint for one in found.robots[1].joints] == ["b", "a"]
    assert [name for name, _ in found.missing] == ["tcp/h:1", "mute", "twin", "odd", "none"]
