"""An HTTP server that connections cannot exhaust: each ends after a time, and there are never more than a few.

``metrics.py`` has its answers.  Python's own ``http.server`` brings mail and TLS, 6 MB, for a page that
needs neither.
"""

from __future__ import annotations

import logging
import socket
import socketserver
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Lock, Thread
from typing import Any

from lostmotion.daemon.exposition import CONTENT_TYPE
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory
from lostmotion.daemon.repeats import Repeats, place

__all__ = ["MOST_CONNECTIONS", "MetricsServer"]

log = logging.getLogger(__name__)

MOST_CONNECTIONS = 16
"""open at the same time: a scrape takes milliseconds, and few programs scrape"""
TIMEOUT_S = 5.0
"""how long a connection may send nothing, or take nothing [s]"""
LONGEST_LINE, MOST_LINES = 8192, 100
"""of a request: a scrape has half a dozen lines of a hundred characters"""


class _Handler(socketserver.StreamRequestHandler):
    """One request and its answer, as HTTP/1.0 has it."""

    page: Callable[[], str]

    def handle(self) -> None:
        words = self.rfile.readline(LONGEST_LINE).split()
        for _ in range(MOST_LINES):
            if not self.rfile.readline(LONGEST_LINE).strip():
                break
        if len(words) != 3 or not words[2].startswith(b"HTTP/"):
            self._answer("400 Bad Request", "found no request of HTTP, expected GET /metrics\n")
        elif words[0] not in (b"GET", b"HEAD"):
            self._answer("405 Method Not Allowed", "expected GET\n")
        elif words[1].split(b"?")[0] not in (b"/metrics", b"/"):
            self._answer("404 Not Found", "expected /metrics\n")
        else:
            self._answer("200 OK", type(self).page(), is_head=words[0] == b"HEAD")

    def _answer(self, status: str, page: str, is_head: bool = False) -> None:
        body = page.encode()
        head = f"HTTP/1.0 {status}\r\nContent-Type: {CONTENT_TYPE}\r\nContent-Length: {len(body)}\r\n\r\n"
        self.wfile.write(head.encode() + (b"" if is_head else body))


class MetricsServer(socketserver.ThreadingTCPServer):
    """Answers at an address, in a thread of its own and one for each connection, until it is closed.

    Where one connection too many is opened the oldest is ended: those that send nothing keep no scrape out, since a
    scrape sends its request at once.  Raises OSError where the address is in use or not one of this computer.
    """

    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = 128  # a burst of connections waits for its turn here

    def __init__(self, host: str, port: int, page: Callable[[], str]) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._connections: dict[socket.socket, None] = {}  # oldest first
        self._lock = Lock()
        self._repeats = Repeats()
        handler = type("Handler", (_Handler,), {"timeout": TIMEOUT_S, "page": staticmethod(page)})
        super().__init__((host, port), handler)
        self._thread = Thread(target=self.serve_forever, name="metrics", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Gives the address back."""
        self.shutdown()
        self.server_close()
        self._thread.join()

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            self._connections[request] = None
            too_many = list(self._connections)[:-MOST_CONNECTIONS]
        for oldest in too_many:
            with suppress(OSError):  # it has ended by itself
                oldest.shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks is not worth a line in the robot's log; an internal error is logged once an hour,
        however many connections meet it."""
        error = sys.exc_info()[1]
        if is_no_memory(error):
            if self._repeats.is_news(NO_MEMORY, time.monotonic()):
                log.error("metrics: no answer to %s: %s", client_address, NO_MEMORY)
        elif isinstance(error, OSError):
            log.debug("metrics: no answer to %s", client_address, exc_info=True)
        elif isinstance(error, Exception) and self._repeats.is_news(place(error), time.monotonic()):
            log.error("metrics: no answer to %s", client_address, exc_info=True)
