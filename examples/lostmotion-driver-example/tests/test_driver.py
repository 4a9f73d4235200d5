"""The driver against the checks that lostmotion has for any driver, and against a controller that says other things."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable

import pytest
from lostmotion_driver_example.gateway import send

from lostmotion.drivers.conformance import CHECKS, Subject

SECONDS = 8.0


@pytest.fixture
def ports() -> tuple[int, int]:
    """Two free UDP ports to which the controller sends: its first datagrams have arrived."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        numbers = one.getsockname()[1], two.getsockname()[1]
        threading.Thread(target=send, args=(*numbers, SECONDS), daemon=True).start()
        for port in (one, two):
            port.recv(65536)
    return numbers


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_joints(check: Callable[[Subject], None], ports: tuple[int, int]) -> None:
    """Two joints do what the service relies on."""
    check(Subject("example_gateway", joints=[{"port": str(ports[0]), "number": number} for number in (1, 2)]))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_accelerometer(check: Callable[[Subject], None], ports: tuple[int, int]) -> None:
    """The sensor does what the service relies on."""
    oscillator = {"f_res_hz": 58.0}
    check(
        Subject("example_gateway", accelerometer={"port": str(ports[1]), "rate_hz": 1000.0, "oscillator": oscillator})
    )


def test_a_joint_that_is_not_sent_is_named(ports: tuple[int, int]) -> None:
    """Joint 7 does not exist: its identity is not ok, and it is silent in the readings."""
    bus = Subject("example_gateway", joints=[{"port": str(ports[0]), "number": 7}]).make()
    bus.open()
    (identity,) = bus.identify()
    readings = [bus.read() for _ in range(10)]
    bus.close()
    assert not identity.ok
    assert "likely cause" in identity.found
    assert readings[-1].silent == ("joint0",)
