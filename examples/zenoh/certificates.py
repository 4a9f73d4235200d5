"""Makes certificates for trying Zenoh with TLS: an authority, a router, and one for each name given.

    pip install cryptography
    python certificates.py /etc/lostmotion/zenoh --host router.local arm1 office

Writes ca.pem, router.pem, router.key, and NAME.pem, NAME.key.  The name is the common name, by which the router's
access list knows its peers.  The authority's key is thrown away: to add a robot, make all of them anew, or run an
authority that deserves the word.  Certificates end after a year.
"""

from __future__ import annotations

import argparse
import ipaddress
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

YEAR = timedelta(days=365)
Key = ec.EllipticCurvePrivateKey


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", help="robots and operators")
    parser.add_argument("--host", action="append", default=[], help="names and addresses of the router")
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    if (given.folder / "ca.pem").exists():
        parser.exit(2, f"{given.folder}: found certificates, which new ones would make worthless; remove them first\n")
    authority = ec.generate_private_key(ec.SECP256R1())
    issuer = name_of("lostmotion test authority")
    write(given.folder / "ca.pem", certificate(issuer, authority, issuer, authority, is_authority=True))
    for name in ("router", *given.names):
        key = ec.generate_private_key(ec.SECP256R1())
        hosts = ["localhost", "127.0.0.1", *given.host] if name == "router" else []
        write(given.folder / f"{name}.pem", certificate(name_of(name), key, issuer, authority, hosts=hosts))
        (given.folder / f"{name}.key").touch(mode=0o600)
        write(given.folder / f"{name}.key", key)


def name_of(common_name: str) -> x509.Name:
    """A subject that has only a common name."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def certificate(
    subject: x509.Name,
    key: Key,
    issuer: x509.Name,
    authority: Key,
    hosts: Sequence[str] = (),
    is_authority: bool = False,
) -> x509.Certificate:
    """A certificate for a year, signed by the authority."""
    now = datetime.now(UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + YEAR)
        .add_extension(x509.BasicConstraints(ca=is_authority, path_length=None), critical=True)
        .add_extension(x509.SubjectAlternativeName([general_name(host) for host in hosts or [common(subject)]]), False)
    )
    return builder.sign(authority, hashes.SHA256())


def general_name(host: str) -> x509.GeneralName:
    """A host's address or name."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host.replace(" ", "-"))


def common(subject: x509.Name) -> str:
    """The common name of a subject."""
    return str(subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def write(path: Path, content: x509.Certificate | Key) -> None:
    """A certificate or a key as PEM."""
    if isinstance(content, x509.Certificate):
        path.write_bytes(content.public_bytes(serialization.Encoding.PEM))
        return
    path.write_bytes(
        content.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )


if __name__ == "__main__":
    main()
