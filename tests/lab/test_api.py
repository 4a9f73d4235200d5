"""The names of ``lostmotion.lab``, which are imported when they are first used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from pkgutil import iter_modules

import pytest

from lostmotion import lab


def test_every_name_is_the_object_of_its_module() -> None:
    """What type checkers and editors see is what is imported, and all of it can be."""
    tree = ast.parse(Path(lab.__file__).read_text())
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: one.module for one in typed.body if isinstance(one, ast.ImportFrom) for alias in one.names}
    assert list(seen) != []
    assert set(seen) == set(lab.__all__)
    for name, module in seen.items():
        value = getattr(lab, name)
        assert value is getattr(sys.modules[str(module)], name)
        assert callable(value)


def test_no_module_has_the_name_of_a_function() -> None:
    """The import of a module would put it in the place of the function of that name."""
    assert not {module.name for module in iter_modules(lab.__path__)} & set(lab.__all__)


def test_names_are_listed_before_they_are_imported() -> None:
    """A notebook completes them; the import of the package loads none of what they need."""
    script = "import sys; from lostmotion import lab; print(*dir(lab)); "
    script += "print(*{'numpy', 'scipy', 'numba'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    listed, loaded = done.stdout.splitlines()
    assert set(lab.__all__) < set(listed.split())
    assert loaded == ""


@pytest.mark.parametrize("shown", ["found._repr_html_()", "found.plot()"])
def test_a_result_is_shown_in_a_fresh_interpreter(shown: str) -> None:
    """A notebook imports the lab and shows a result, before anything has imported the report."""
    script = f"""
import numpy as np
from lostmotion.drivers.recording import Recording
from lostmotion.lab import build_model, compare, experiments
time = np.arange(0.0, 2.0, 0.02)
swing = Recording(time, {{"position": np.cos(5 * time)}})
model = build_model("joint", ["gravity_torque"])
found = compare(model, experiments(model, [swing]), is_described=False)
assert {shown}
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_unknown_name() -> None:
    """A slip is an AttributeError, as of any module."""
    with pytest.raises(AttributeError, match="no attribute 'explian'"):
        lab.explian  # noqa: B018
