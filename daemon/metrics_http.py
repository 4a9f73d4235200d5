"""An HTTP server that connections cannot exhaust: each ends after a time, and there are never more than a few.

What it answers is ``metrics.py``'s business.
"""

from __future__ import annotations

import logging
import socket
import socketserver
import sys
from contextlib import suppress
from http.server import ThreadingHTTPServer
from threading import Lock, Thread
from typing import Any

from prometheus_client import CollectorRegistry, MetricsHandler

__all__ = ["MOST_CONNECTIONS", "MetricsServer"]

log = logging.getLogger(__name__)

MOST_CONNECTIONS = 16
"""open at the same time: a scrape takes milliseconds, and few programs scrape"""
TIMEOUT_S = 5.0
"""how long a connection may send nothing, or take nothing [s]"""


class MetricsServer(ThreadingHTTPServer):
    """Answers at an address, in a thread of its own and one for each connection, until it is closed.

    Where one connection too many is opened the oldest is ended: those that send nothing keep no scrape out, since a
    scrape sends its request at once.  Raises OSError when the address cannot be had.
    """

    request_queue_size = 128  # a burst of connections waits for its turn here

    def __init__(self, host: str, port: int, registry: CollectorRegistry) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._connections: dict[socket.socket, None] = {}  # oldest first
        self._lock = Lock()
        handler = type("Handler", (MetricsHandler.factory(registry),), {"timeout": TIMEOUT_S})
        super().__init__((host, port), handler)
        self._thread = Thread(target=self.serve_forever, name="metrics", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Gives the address back."""
        self.shutdown()
        self.server_close()
        self._thread.join()

    def server_bind(self) -> None:
        """Without the base's question for this computer's name, which may wait for a name server."""
        socketserver.TCPServer.server_bind(self)

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
        """A connection that breaks is not worth a line in the robot's log."""
        is_ours = not isinstance(sys.exc_info()[1], OSError)
        log.log(logging.ERROR if is_ours else logging.DEBUG, "metrics: no answer to %s", client_address, exc_info=True)
