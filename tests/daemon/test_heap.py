"""Memory that is not needed any more goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries do as they like")
def test_pages_between_used_ones_are_given_back() -> None:
    """Of 20 MB in pieces of 10 kB, of which each hundredth stays, at least 15 MB are given back."""
    program = """if True:
        import re
        from lostmotion.daemon import heap
        heap.set_up()
        def resident():
            return int(re.search(r"VmRSS:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1000
        pieces = [bytes(10_000) for _ in range(2000)]
        kept = pieces[::100]
        del pieces
        before = resident()
        heap.give_back()
        print(before - resident())
    """
    done = subprocess.run([sys.executable, "-c", program], timeout=60, check=True, capture_output=True, text=True)
    assert float(done.stdout) > 15
