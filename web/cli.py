"""``lostmotion web``: the arguments, and the server that runs the application."""

from __future__ import annotations

import logging
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.options import FILE, config_file, database
from lostmotion.daemon.commands.where import find_config
from lostmotion.daemon.options import WebOptions
from lostmotion.daemon.paths import expanded
from lostmotion.daemon.sockets import host_and_port, page_refusal
from lostmotion.drivers.errors import LostmotionError

if TYPE_CHECKING:
    from lostmotion.web.security import Keys
    from lostmotion.web.site import Site

__all__ = ["WebError", "web"]

LEAST_TOKEN = 16
GRACE_S = 3


class WebError(LostmotionError):
    """The page cannot be served so."""


@click.command()
@config_file
@database
@click.option("--listen", metavar="H:P", help="Address and port, instead of web.listen (127.0.0.1:8737).")
@click.option("--hash-password", is_flag=True, help="Ask for a password and print its line for the configuration.")
@click.option("--connect", multiple=True, metavar="ENDPOINT", help="Show the fleet that is found there, too: a router"
              " or robot, such as tcp/10.0.0.1:7447; again for more.")  # fmt: skip
@click.option(
    "--robots", metavar="A,B", help="Robots of the fleet that must answer, in addition to those that are alive."
)
@click.option("--zenoh", type=FILE, metavar="FILE", help="Zenoh's own configuration (JSON5) for the fleet: TLS.")
def web(
    config: Path | None,
    database: Path | None,
    listen: str | None,
    hash_password: bool,
    connect: tuple[str, ...],
    robots: str | None,
    zenoh: Path | None,
) -> None:
    """Serve the page: health, alarms, history and windows, in a browser.

    On this computer alone, unless [web] has a password or a token.  Ctrl-C ends it.
    """
    from lostmotion.web import security
    from lostmotion.web.site import Site

    if hash_password:
        password = _password()
        output.print_lines([f'password_hash = "{security.hash_password(password)}"'])
        return
    found = find_config(config)
    options = found.web
    options = msgspec.structs.replace(options, listen=listen or options.listen)
    address, refusal = host_and_port(options.listen), page_refusal(options, found.metrics)
    if refusal or address is None:
        raise WebError(refusal)
    keys = security.Keys(options.password_hash, _token(options))
    fleet = None
    if connect or zenoh:
        from lostmotion.daemon.commands.fleet_ask import Fleet

        fleet = Fleet.of(connect, zenoh, config, robots)
    _serve(Site.of(config, database, fleet), options, address, keys)


def _password() -> str:
    """What a person types twice, or the first line of a file or pipe."""
    if sys.stdin.isatty():
        typed: str = click.prompt("password", hide_input=True, confirmation_prompt=True, err=True)
        return typed
    line = sys.stdin.readline().rstrip("\r\n")
    if not line:
        raise WebError("--hash-password: found no password on standard input, expected one line")
    return line


def _token(options: WebOptions) -> str:
    if not options.token_file:
        return ""
    try:
        token = expanded("web.token_file", options.token_file).read_text("utf-8").strip()
    except (OSError, ValueError) as error:
        raise WebError(f"web.token_file: {options.token_file} cannot be read: {error}") from error
    if len(token) < LEAST_TOKEN:
        raise WebError(f"web.token_file: found {len(token)} characters, expected at least {LEAST_TOKEN}")
    return token


def _serve(site: Site, options: WebOptions, address: tuple[str, int], keys: Keys) -> None:
    import uvicorn

    from lostmotion.web.app import create_app
    from lostmotion.web.connections import MOST_OPEN, Connection, is_worth_a_line

    certificate, key = (
        str(expanded(f"web.{name}", path)) if path else None
        for name, path in (("certificate", options.certificate), ("key", options.key))
    )
    settings = uvicorn.Config(
        create_app(site, keys), http=Connection, ws="none", log_level="warning", access_log=False, server_header=False,
        limit_concurrency=MOST_OPEN, timeout_graceful_shutdown=GRACE_S, ssl_certfile=certificate, ssl_keyfile=key,
    )  # fmt: skip
    try:
        settings.load()
    except OSError as error:  # those of ssl, too
        raise WebError(f"web.certificate, web.key: {certificate}, {key} cannot be used: {error}") from error
    logging.getLogger("uvicorn.error").addFilter(is_worth_a_line)
    with _bound(options, address) as listener:
        port = listener.getsockname()[1]
        scheme = "https" if options.certificate else "http"
        host = f"[{address[0]}]" if ":" in address[0] else address[0]
        sys.stderr.write(f"serving {scheme}://{host}:{port}/ (Ctrl-C ends it)\n")
        sys.stderr.flush()
        uvicorn.Server(settings).run(sockets=[listener])


def _bound(options: WebOptions, address: tuple[str, int]) -> socket.socket:
    """A socket that listens; port 0: any that is free."""
    family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
    listener = socket.socket(family)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(address)
        listener.listen()
    except OSError as error:
        listener.close()
        raise WebError(
            f"web.listen: cannot listen at {options.listen} ({error.strerror}); does another program use it?"
        ) from error
    return listener
