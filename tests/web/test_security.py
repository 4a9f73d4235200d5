"""Who may see and change what: host, password, token, session, origin, headers; what `lostmotion web` refuses."""

from __future__ import annotations

import http.client
import signal
import socket
import ssl
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlencode, urlsplit

import pytest
from argon2 import PasswordHasher
from click.testing import CliRunner
from playwright.sync_api import expect

from lostmotion.daemon.cli import cli
from lostmotion.web.security import Throttle, hash_password
from tests.conftest import ROOT
from tests.daemon.cli_world import call, is_one_line
from tests.daemon.conftest import wait_until
from tests.web.conftest import Open, Serve, Site
from tests.web.world import fill, robot

PASSWORD = "correct horse"
ACK = {"joint": "elbow", "verb": "ack"}


@pytest.fixture
def locked(tmp_path: Path, serve: Serve) -> Site:
    """A page with a password and a token."""
    fill(tmp_path / "history.db", count=20)
    (tmp_path / "token").write_text("t" * 32)
    lines = f'[web]\npassword_hash = "{hash_password(PASSWORD)}"\ntoken_file = "token"\n'
    return serve("--config", robot(tmp_path, extra=lines))


@pytest.fixture(scope="module")
def open_site(tmp_path_factory: pytest.TempPathFactory, serve_all: Callable[[Path, Path], Site]) -> Site:
    """A page on this computer alone."""
    folder = tmp_path_factory.mktemp("robot")
    fill(folder / "history.db", count=20)
    return serve_all(folder, robot(folder))


def log_in(site: Site, password: str = PASSWORD, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """The form, sent."""
    form = urlencode({"password": password}).encode()
    return site.ask("POST", "/login", form, content_type="application/x-www-form-urlencoded", **headers)


def test_a_foreign_name_is_not_answered(open_site: Site) -> None:
    """DNS rebinding: a page of evil.example that resolves to this computer sees nothing."""
    for host in ("evil.example", "evil.example:8737", "", "127.0.0.1.evil.example"):
        status, _, body = open_site.ask("GET", "/", host=host)
        assert status in (400, 421), host
        assert b"elbow" not in body
    assert open_site.ask("GET", "/", host="localhost:1")[0] == 200


def test_changes_need_origin_and_token(open_site: Site) -> None:
    """A form of another page, a missing or a wrong token change nothing; the page's own token does."""
    token = open_site.csrf()
    for headers in ({}, {"x_csrf_token": "x"}, {"x_csrf_token": token, "origin": "https://evil.example"},
                    {"x_csrf_token": token, "sec_fetch_site": "cross-site"}):  # fmt: skip
        assert open_site.ask("POST", "/api/alarms", ACK, **headers)[0] == 403, headers
    status, _, body = open_site.ask("POST", "/api/alarms", ACK, x_csrf_token=token, origin=open_site.address)
    assert status == 200, body
    assert b"acknowledged" in body


@pytest.mark.slow
def test_without_the_password_nothing_is_seen(locked: Site) -> None:
    """Pages lead to the form, scripts get 401; wrong passwords get neither, and after five of them one waits."""
    status, headers, _ = locked.ask("GET", "/", accept="text/html")
    assert (status, headers["location"]) == (303, "/login")
    for path in ("/api/status", "/api/events", "/joints/elbow", "/api/joints/elbow/series"):
        assert locked.ask("GET", path)[0] == 401
    assert locked.ask("POST", "/api/alarms", ACK)[0] == 401
    assert [log_in(locked, "wrong")[0] for _ in range(5)] == [401] * 5
    assert log_in(locked)[0] == 429


def test_a_session_begins_and_ends(locked: Site) -> None:
    """The cookie is the browser's alone; with it the page answers until one logs out."""
    status, headers, _ = log_in(locked)
    assert status == 303
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    name = cookie.split(";")[0]
    status, _, body = locked.ask("GET", "/", cookie=name)
    assert status == 200
    token = body.decode().split('name="csrf" content="')[1].split('"')[0]
    assert locked.ask("POST", "/api/alarms", ACK, cookie=name)[0] == 403
    assert locked.ask("POST", "/api/alarms", ACK, cookie=name, x_csrf_token=token)[0] == 200
    assert locked.ask("POST", "/logout", b"", cookie=name, x_csrf_token=token)[0] == 303
    assert locked.ask("GET", "/api/status", cookie=name)[0] == 401


@pytest.mark.slow
def test_a_page_whose_session_has_ended_leads_to_the_form(tmp_path: Path, serve: Serve, look: Open) -> None:
    """The server was started again and knows no session any more: the page that is open asks for the password, and
    shows the robot after it."""
    fill(tmp_path / "history.db", count=20)
    config = robot(tmp_path, extra=f'[web]\npassword_hash = "{hash_password(PASSWORD)}"\n')
    first = serve("--config", config)
    page = look(first.address, complains=True)  # the browser's console tells of 401
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    page.locator("body[data-updated]").wait_for()
    first.close()
    serve("--config", config, "--listen", urlsplit(first.address).netloc)
    page.wait_for_url(f"{first.address}/login")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator('[data-joint="elbow"].card')).to_be_visible()


@pytest.mark.slow
def test_with_a_certificate_nothing_goes_in_the_clear(tmp_path: Path, serve: Serve) -> None:
    """TLS by files: a client that trusts the authority reads the form and gets a cookie that is for TLS only; one that
    does not is refused, and so is a request in the clear."""
    fill(tmp_path / "history.db", count=20)
    script = ROOT / "examples" / "zenoh" / "certificates.py"
    subprocess.run([sys.executable, script, tmp_path], check=True)
    lines = f'[web]\npassword_hash = "{hash_password(PASSWORD)}"\ncertificate = "router.pem"\nkey = "router.key"\n'
    site = serve("--config", robot(tmp_path, extra=lines))
    assert site.address.startswith("https://")
    where = urlsplit(site.address).netloc
    trusting = ssl.create_default_context(cafile=str(tmp_path / "ca.pem"))
    connection = http.client.HTTPSConnection(where, context=trusting, timeout=60)
    form = {"content-type": "application/x-www-form-urlencoded"}
    connection.request("POST", "/login", urlencode({"password": PASSWORD}), form)
    answer = connection.getresponse()
    assert answer.status == 303
    assert "Secure" in (answer.getheader("set-cookie") or "")
    connection.close()
    with pytest.raises(ssl.SSLCertVerificationError):
        http.client.HTTPSConnection(where, timeout=60).request("GET", "/")
    clear = http.client.HTTPConnection(where, timeout=60)
    clear.request("GET", "/login")
    with pytest.raises((ConnectionError, http.client.BadStatusLine)):
        clear.getresponse()


def test_a_program_has_a_token(locked: Site) -> None:
    """A bearer token reads and changes; another one does not."""
    assert locked.ask("GET", "/api/status", authorization=f"Bearer {'t' * 32}")[0] == 200
    assert locked.ask("POST", "/api/alarms", ACK, authorization=f"Bearer {'t' * 32}")[0] == 200
    assert locked.ask("GET", "/api/status", authorization=f"Bearer {'u' * 32}")[0] == 401


def test_every_answer_has_its_headers(open_site: Site) -> None:
    """No inline script, no frame, no sniffing, no cache; also of errors and static files."""
    for path in ("/", "/nothing", "/static/web.css", "/api/status"):
        _, headers, body = open_site.ask("GET", path)
        policy = headers["content-security-policy"]
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert b"<script>" not in body
    assert open_site.ask("GET", "/static/../web.css")[0] == 404
    assert open_site.ask("GET", "/static/%2e%2e/app.py")[0] == 404


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{", b'{"joint": "elbow", "verb": "erase"}', b'{"joint": "elbow", "verb": "shelve"}',
             b'{"joint": "nobody", "verb": "ack"}', b"x" * 20_000]
)  # fmt: skip
def test_bad_requests_are_refused(open_site: Site, body: bytes) -> None:
    """A status from 400 to 499 and a sentence."""
    status, _, answer = open_site.ask("POST", "/api/alarms", body, x_csrf_token=open_site.csrf())
    assert 400 <= status < 500
    assert b"error" in answer


@pytest.mark.parametrize(
    "begun", [b"", b"GET / HTTP/1.1\r\nHost: ", b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n"]
)
def test_half_a_request_keeps_nobody_out(open_site: Site, begun: bytes) -> None:
    """Where 200 connections have not sent a whole request, another one is answered, and the oldest are closed."""
    url = urlsplit(open_site.address)
    with ExitStack() as stack:
        others = []
        for _ in range(200):
            others.append(stack.enter_context(socket.create_connection((url.hostname, url.port))))
            others[-1].sendall(begun)
        assert open_site.ask("GET", "/health")[0] == 200
        others[0].settimeout(20)
        with suppress(ConnectionResetError):
            assert others[0].recv(1) == b""


def test_the_end_is_quick_and_quiet(tmp_path: Path, serve: Serve) -> None:
    """Ctrl-C while a page hears the news and an upload has stopped halfway, after another one was given up: no
    traceback, and no wait for what would not end."""
    fill(tmp_path / "history.db", count=20)
    site = serve("--config", robot(tmp_path))
    url = urlsplit(site.address)
    upload = f"POST /api/lab/recordings?name=a.csv HTTP/1.1\r\nHost: localhost\r\nX-CSRF-Token: {site.csrf()}\r\n"
    with ExitStack() as stack:
        given_up, stopped, page = (
            stack.enter_context(socket.create_connection((url.hostname, url.port))) for _ in range(3)
        )
        for one in (given_up, stopped):
            one.sendall(f"{upload}Content-Length: 99\r\n\r\ntime,accel\n".encode())
        page.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert page.recv(100).startswith(b"HTTP/1.1 200")
        given_up.close()
        wait_until(lambda: len(list((tmp_path / "lab" / "recordings").glob(".*.part"))) == 1)
        site.process.send_signal(signal.SIGINT)
        site.process.wait(60)
    assert [line for line in site.log.splitlines() if not line.startswith("serving ")] == []


@pytest.mark.parametrize(
    ("lines", "arguments", "words"),
    [
        ("", ["--listen", "0.0.0.0:8737"], ["which others can reach", "web.password_hash"]),
        ("", ["--listen", "nowhere"], ["web.listen", "ADDRESS:PORT"]),
        ("", ["--listen", "127.0.0.1:99999"], ["web.listen"]),
        ('[web]\ntoken_file = "gone"\n', [], ["web.token_file", "gone"]),
        ('[web]\ncertificate = "a.pem"\n', [], ["web.key"]),
        ('[web]\ncertificate = "a.pem"\nkey = "b.pem"\n', [], ["web.certificate", "a.pem", "b.pem", "No such file"]),
        ('[web]\nlab = "~nosuchuser/lab"\n', [], ["web.lab", "~nosuchuser", "no home folder"]),
        ('[web]\nown_effects = ["~nosuchuser/a.py:f"]\n', [], ["web.own_effects", "no home folder"]),
        ("[web]\ncolour = 1\n", [], ["web.colour: unknown key"]),
    ],
)
def test_what_would_be_open_to_the_world_is_refused(
    tmp_path: Path, lines: str, arguments: list[str], words: list[str]
) -> None:
    """One line, status 2."""
    result = call("web", "--config", robot(tmp_path, extra=lines), *arguments)
    assert is_one_line(result, *words), result.output


@pytest.mark.parametrize(("typed", "status"), [("", 2), ("\n", 2), ("secret\nmore", 0), ("secret", 0)])
def test_a_password_comes_from_a_pipe(typed: str, status: int) -> None:
    """The first line; without one an error of one line."""
    result = CliRunner().invoke(cli, ["web", "--hash-password"], input=typed)
    assert result.exit_code == status
    if status:
        assert is_one_line(result, "no password on standard input")
    else:
        assert PasswordHasher().verify(result.stdout.split('"')[1], "secret")


def test_a_port_that_is_taken_is_named(tmp_path: Path) -> None:
    """One line, status 2."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        result = call("web", "--config", robot(tmp_path), "--listen", f"127.0.0.1:{other.getsockname()[1]}")
    assert is_one_line(result, "cannot listen at", "another program")


def test_the_throttle_forgets() -> None:
    """Five failures within the time wait; a right password, or the time, ends it."""
    throttle = Throttle(tries=2, within_s=1e-9)
    throttle.fail("a")
    throttle.fail("a")
    assert throttle.wait_s("a") == 0.0
    throttle = Throttle(tries=2, within_s=60.0)
    throttle.fail("a")
    throttle.fail("a")
    assert 59 < throttle.wait_s("a") <= 60
    assert throttle.wait_s("b") == 0.0
    throttle.forgive("a")
    assert throttle.wait_s("a") == 0.0
