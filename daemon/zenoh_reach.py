"""Why an endpoint of Zenoh does not answer, of which Zenoh only says that it could not connect: a connection is tried.

Nothing is sent over TCP; over TLS a handshake is made, without a certificate of our own.
"""

from __future__ import annotations

import re
import socket
from typing import NamedTuple

__all__ = ["TIMEOUT_S", "Endpoint", "cause"]

TIMEOUT_S = 1.0
"""How long an endpoint may take to answer [s]: within a robot it does in milliseconds.  Whoever asks waits so long."""
ENDPOINT = re.compile(r"(?P<protocol>tcp|tls|ws)/\[?(?P<host>[^\]/#?]+)\]?:(?P<port>\d+)(?:[#?].*)?")


class Endpoint(NamedTuple):
    """Where a connection goes, as Zenoh writes it: ``tls/10.0.0.1:7447#root_ca_certificate_file=/etc/ca.pem``."""

    protocol: str
    host: str
    port: int

    @classmethod
    def of(cls, text: str) -> Endpoint | None:
        """None for one over which no TCP connection is made, as a serial port, and for one that is none."""
        found = ENDPOINT.fullmatch(text)
        return cls(found["protocol"], found["host"], int(found["port"])) if found else None


def cause(text: str, authority: str = "") -> str:
    """Why no session opens over an endpoint, in a few words; "" where that is not known.  authority: the file of the
    certificates that are trusted, "" for those of the system.  Takes up to twice ``TIMEOUT_S``."""
    endpoint = Endpoint.of(text)
    if endpoint is None:
        return ""
    try:
        with socket.create_connection((endpoint.host, endpoint.port), TIMEOUT_S) as connection:
            connection.settimeout(TIMEOUT_S)
            if endpoint.protocol == "tls":
                return _of_handshake(connection, endpoint.host, authority)
    except ConnectionRefusedError:
        return "connection refused"
    except TimeoutError:
        return f"no answer within {TIMEOUT_S:g} s"
    except socket.gaierror:
        return f"the host {endpoint.host} is not known"
    except (OSError, OverflowError, UnicodeError) as error:
        return str(getattr(error, "strerror", None) or error).lower()
    return "connections are taken, but Zenoh opens no session; is it a router, without TLS?"


def _of_handshake(connection: socket.socket, host: str, authority: str) -> str:
    import ssl  # 3 MB that many do not need

    try:
        context = ssl.create_default_context(cafile=authority or None)
        with context.wrap_socket(connection, server_hostname=host):
            return "TLS answers, but Zenoh opens no session; is its own certificate accepted there?"
    except ssl.SSLCertVerificationError as error:
        return f"TLS: the certificate is not accepted: {error.verify_message}"
    except TimeoutError:
        return "TLS: no answer to the handshake; is it a TLS endpoint?"
    except OSError as error:
        reason = str(getattr(error, "reason", None) or error.strerror or error).replace("_", " ").lower()
        return f"TLS: no handshake: {reason}; is it a TLS endpoint?"
