"""What holds for all tests of drivers."""

from __future__ import annotations

import pytest

from tests.drivers.rigs import wait_long


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only a servo that is silent is taken for one."""
    wait_long(monkeypatch)
