"""Model files: what they say is what the model has, what is wrong is one line, and nothing is lost on the way."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.lab.errors import ModelFileError
from lostmotion.lab.models.modelfile import ModelFile, dumps, load, loads, save
from lostmotion.model import Parameter, build_model
from tests.conftest import ROOT

EXAMPLES = sorted((ROOT / "examples" / "models").glob("*.toml"))

PAGE = """
base = "play"                      # play | oscillator | joint | servo
effects = ["coulomb_friction"]     # in any order
[parameters]
d = { value = 6e-5, unit = "m", low = 1e-6, high = 1e-3 }        # free: lab fit estimates it
R1 = { value = 0.012, unit = "m", fixed = true }
coulomb_friction.tau_c = { value = 1e-4, unit = "N m" }
"""


def test_the_format_as_documented() -> None:
    """Values, bounds and what is fixed reach the model; what the file does not say keeps its default."""
    model = loads(PAGE, "page").build()
    d, r1 = model.parameters["d"], model.parameters["R1"]
    assert (d.value, d.low, d.high, d.fixed) == (6e-5, 1e-6, 1e-3, False)
    assert (r1.value, r1.fixed) == (0.012, True)
    assert model.parameters["coulomb_friction.tau_c"].value == 1e-4
    assert model.parameters["J2"] == build_model("play").parameters["J2"]


def test_a_joint_may_be_an_axis_along_a_line() -> None:
    """Its parameters may be given in N for N m, N s/m for N m s/rad and kg for kg m^2; others turn."""
    effects = 'effects = ["viscous_friction", "coulomb_friction"]'
    file = f'base = "{{}}"\n{effects}\n[parameters]\n{{}} = {{{{ value = 2, unit = "{{}}" }}}}'
    units = {"viscous_friction.b_v": "N s/m", "coulomb_friction.tau_c": "N", "J": "kg"}
    for name, unit in units.items():
        turning = build_model("joint", effects=["viscous_friction", "coulomb_friction"]).parameters[name].unit
        for given_unit in (unit, turning):
            read = loads(file.format("joint", name, given_unit), "page").parameters[name]
            assert (read.value, read.unit) == (2.0, turning)
    with pytest.raises(ModelFileError, match="the unit is 'N', expected 'N m'"):
        loads(file.format("play", "coulomb_friction.tau_c", "N"), "page")


def test_the_unit_1_is_none() -> None:
    """A parameter without a unit may say so, one in metres may not; it was refused of both."""
    file = 'base = "play"\neffects = ["gear_eccentricity"]\n[parameters]\n{} = {{ value = 9, unit = "1" }}'
    for name in ("n", "gear_eccentricity.N"):
        parameter = loads(file.format(name), "x.toml").build().parameters[name]
        assert (parameter.value, parameter.unit) == (9.0, "")
    with pytest.raises(ModelFileError, match="d: the unit is '1', expected 'm'"):
        loads(file.format("d"), "x.toml")


def test_a_name_of_a_page_is_not_told_in_full() -> None:
    """The refusal of an effect of 5000 characters had all of them."""
    with pytest.raises(ModelFileError, match=r"^x\.toml: no effect is called 'aaa") as refused:
        loads(f'base = "servo"\neffects = ["{"a" * 5000}"]\n', "x.toml")
    assert len(str(refused.value)) < 1000


def test_a_nul_in_the_name_of_a_file_of_effects_is_refused() -> None:
    """It was an internal error: no path may hold one."""
    with pytest.raises(ModelFileError, match=r"^x\.toml: 'a.*b\.py:c': found a NUL, expected the name of a file"):
        loads('base = "servo"\neffects = ["a\\u0000b.py:c"]\n', "x.toml")


@pytest.mark.parametrize(
    "line",
    [
        "coulomb_friction.tau_c = 3e-4",
        '"coulomb_friction.tau_c" = 3e-4',
        "coulomb_friction = { tau_c = 3e-4 }",
        "coulomb_friction = { tau_c = { value = 3e-4 } }",
        "[parameters.coulomb_friction]\ntau_c = 3e-4",
    ],
)
def test_parameters_of_effects_in_every_form(line: str) -> None:
    """A dotted key, a quoted one, a nested table and a plain number all mean the same parameter."""
    text = f'base = "play"\neffects = ["coulomb_friction"]\n[parameters]\n{line}\n'
    assert loads(text, "x").build().parameters["coulomb_friction.tau_c"].value == 3e-4


def test_fixed_is_kept_unless_the_file_says_otherwise() -> None:
    """beta is fixed by default: a new value leaves it so, and only `fixed = false` frees it."""
    head = 'base = "play"\n[parameters]\n'
    assert loads(head + "beta = { value = 10 }", "x").build().parameters["beta"].fixed
    assert loads(head + "beta = 10", "x").build().parameters["beta"].fixed
    assert not loads(head + "beta = { value = 10, fixed = false }", "x").build().parameters["beta"].fixed
    assert loads(head + "d = { value = 5e-5, fixed = true }", "x").build().parameters["d"].fixed


@given(
    st.permutations(["d", "alpha", "R1", "bias", "beta", "coulomb_friction.tau_c", "viscous_friction.b_v"]),
    st.integers(0, 7),
    st.floats(1e-5, 1e-4),
    st.booleans(),
    st.booleans(),
)
def test_round_trip_loses_nothing(names: list[str], count: int, value: float, bounded: bool, fixed: bool) -> None:
    """Values bit by bit, bounds, fixed or free, and the order all come back."""
    units = build_model("play", ["coulomb_friction", "viscous_friction"]).parameters
    bounds = {"low": value / 3, "high": value * 3} if bounded else {}
    scale = {"beta": 1e5, "alpha": 1e8, "R1": 1e3}
    parameters = {}
    for name in names[:count]:
        factor = scale.get(name, 1.0)
        scaled = {key: bound * factor for key, bound in bounds.items()}
        parameters[name] = Parameter(value * factor, units[name].unit, fixed=fixed, **scaled)
    model = ModelFile("play", ("viscous_friction", "coulomb_friction"), parameters)
    back = loads(dumps(model), "x")
    assert back == model
    assert list(back.parameters) == list(model.parameters)


def test_written_file_is_readable(tmp_path: Path) -> None:
    """One line a parameter, in the file's own order."""
    save(loads(PAGE, "page"), tmp_path / "m.toml")
    assert (tmp_path / "m.toml").read_text() == (
        'base = "play"\n'
        'effects = ["coulomb_friction"]\n'
        "\n"
        "[parameters]\n"
        'd = { value = 6e-05, unit = "m", low = 1e-06, high = 0.001 }\n'
        'R1 = { value = 0.012, unit = "m", fixed = true }\n'
        'coulomb_friction.tau_c = { value = 0.0001, unit = "N m" }\n'
    )
    with pytest.raises(ModelFileError, match="cannot be written"):
        save(loads(PAGE, "page"), tmp_path / "none" / "m.toml")


def test_a_recording_in_the_place_of_the_model(tmp_path: Path) -> None:
    """MODEL and REC in the wrong order: the error tells the order."""
    (tmp_path / "rec.csv").write_text("time,accel\n0,1\n")
    with pytest.raises(ModelFileError, match=r"line 1 is 'time,accel'.*expected the model first, then the recordings"):
        load(tmp_path / "rec.csv")


def test_a_parameter_keeps_its_default_value_where_only_bounds_or_freedom_are_stated() -> None:
    """``n = { fixed = false }`` frees it, ``d = { high = … }`` widens its bounds; an effect's parameters likewise."""
    text = (
        'base = "play"\neffects = ["coulomb_friction"]\n[parameters]\nn = { fixed = false }\nd = { high = 5e-3 }\n'
        "coulomb_friction.tau_c = { low = 1e-6 }\n"
    )
    file = loads(text, "m.toml")
    usual, found = build_model("play", effects=["coulomb_friction"]).parameters, file.build().parameters
    assert [found[name].value for name in found] == [usual[name].value for name in usual]
    assert not found["n"].fixed
    assert (found["d"].low, found["d"].high) == (usual["d"].low, 5e-3)
    assert found["coulomb_friction.tau_c"].low == 1e-6
    assert loads(dumps(file), "m.toml") == file
    with pytest.raises(ModelFileError, match=r"d: 8e-05 lies outside its own bounds 0.001 to"):
        loads('base = "play"\n[parameters]\nd = { low = 1e-3 }\n', "m.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "base is missing; expected one of play, oscillator, joint, servo"),
        ("base = 5", "base: found 5, expected a text"),
        ('base = "play"\neffects = "gravity_torque"', "effects: found 'gravity_torque', expected a list"),
        ('base = "play"\neffects = [2]', "effects[0]: found 2, expected a text"),
        ('base = "play"\nparameters = 3', "parameters: found 3, expected a table"),
        ("base = ", "no valid TOML"),
        ('base = "gear"', "no base is called 'gear'; there are play, oscillator, joint, servo"),
        ('base = "play"\neffect = []', "unknown key 'effect', expected some of base, effects, parameters"),
        ('base = "play"\neffects = ["rust"]', "'rust'"),
        ('base = "joint"\neffects = ["gear_eccentricity"]', "gear_eccentricity does not act on the base 'joint'"),
        ('base = "play"\neffects = ["coulomb_friction", "coulomb_friction"]', "listed twice"),
        ('base = "play"\n[parameters]\nq = 1', "no parameter is called 'q'; there are R1"),
        ('base = "play"\n[parameters]\ncoulomb_friction.tau_c = 1', "no parameter is called 'coulomb_friction.tau_c'"),
        ('base = "play"\n[parameters]\nd = { unit = "m" }', "d: value is missing"),
        ('base = "play"\n[parameters]\nd = {}', "d: value is missing"),
        (
            'base = "play"\n[parameters]\nd = { value = 1e-4, max = 2 }',
            "d: unknown key 'max', expected some of value, unit",
        ),
        ('base = "play"\n[parameters]\nd = { value = 0.1, unit = "mm" }', "d: the unit is 'mm', expected 'm'"),
        (
            'base = "play"\n[parameters]\nd = { value = 0.06, unit = "mm", low = 1e-6, high = 1e-3 }',
            "'mm', expected 'm'",
        ),
        ('base = "play"\n[parameters]\nn = { value = 11, unit = "m" }', "n: the unit is 'm', expected none"),
        ('base = "play"\n[parameters]\nd = { value = 1e-4, low = 2e-4 }', "d: 0.0001 lies outside its own bounds"),
        (
            'base = "play"\n[parameters]\nd = { value = 1e-4, low = 3e-4, high = 2e-4 }',
            "d: low = 0.0003 is more than high",
        ),
        ('base = "play"\n[parameters]\nd = "wide"', "d: found 'wide', expected a number, or a table"),
        ('base = "play"\n[parameters]\nd = true', "d: value: found True, expected a number"),
        ('base = "play"\n[parameters]\nd = { value = "1" }', "d: value: found '1', expected a number"),
        ('base = "play"\n[parameters]\nd = nan', "d: nan m is not possible; it must be a finite number"),
        ('base = "play"\n[parameters]\nd = -1', "-1 m is not possible; it must be more than 0"),
    ],
)
def test_what_is_wrong_is_one_line(text: str, message: str) -> None:
    """The message names the file, the parameter, and what was expected."""
    with pytest.raises(ModelFileError) as caught:
        loads(text, "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_base_name_stands_for_a_file(tmp_path: Path) -> None:
    """A bare base is a model; a path that is neither a file nor a base is told with the bases there are."""
    assert load("servo") == ModelFile("servo")
    with pytest.raises(ModelFileError, match=r"No such file or directory; expected a model file or a base \(play"):
        load(tmp_path / "none.toml")
    (tmp_path / "binary").write_bytes(b"\xff\xfe")
    with pytest.raises(ModelFileError, match="no UTF-8 text"):
        load(tmp_path / "binary")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_models(path: Path) -> None:
    """Every example builds, and survives being written and read."""
    model = load(path)
    assert loads(dumps(model), "again") == model
    assert len(model.build().parameters) > len(model.parameters) > 0
