"""Packages that a light installation may lack, and the line that installs each.  Imports none of them."""

from __future__ import annotations

import sys
from importlib.util import find_spec

__all__ = ["install_line", "is_there", "missing"]

DISTRIBUTIONS = {
    "numba": "numba scipy",  # the one is of little use without the other
    "llvmlite": "numba scipy",
    "scipy": "numba scipy",
    "zenoh": "eclipse-zenoh",
    "can": "python-can",
    "canopen": "canopen cantools",
    "cantools": "canopen cantools",
    "sqlite_utils": "sqlite-utils",
    "dynamixel_sdk": "dynamixel-sdk",
    "serial": "pyserial",
    "pyarrow": "pyarrow",
    "h5py": "h5py",
    "mcap": "mcap rosbags",
    "rosbags": "mcap rosbags",
    "rerun": "rerun-sdk",
    "distributed": "distributed",
    "python_calamine": "python-calamine",
    "matplotlib": "matplotlib",
    "plotext": "plotext",
    "rich": "rich",
}
"""what pip calls the packages that are imported by these names; not the extras, by which pip would bring all that a
light installation leaves out (440 MB)"""


def is_there(name: str) -> bool:
    """Whether a package can be imported."""
    return find_spec(name) is not None


def install_line(name: str) -> str:
    """The command that installs it beside this program."""
    return f"{sys.executable} -m pip install {DISTRIBUTIONS.get(name, name)}"


def missing(name: str | None, needs: str) -> str | None:
    """One line for a package of lostmotion's that is not installed, None for any other.  needs: what needs it."""
    package = (name or "").partition(".")[0]
    if package not in DISTRIBUTIONS:
        return None
    return f"{needs} needs the package {package}, which is not installed here: {install_line(package)}"
