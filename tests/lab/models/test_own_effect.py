"""Effects of one's own: the same numbers as the catalogue's, whatever they act on; what is wrong is one line."""

from __future__ import annotations

import math
import pickle
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from lostmotion.daemon.cli import cli
from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own import OwnEffect, load_effect
from lostmotion.model import HandWaved, ModelError, Sine, Trajectory, build_model
from lostmotion.model.effects import registry, unregister
from tests.conftest import ROOT

EXAMPLE = ROOT / "examples" / "tight_spot_effect.py"
TIMES = np.arange(401) * 1e-3
MOTION = HandWaved(seed=5, high_hz=6.0)
HEAD = """
import math
from lostmotion.lab import Parameter, effect
TAU = {"tau": Parameter(2e-4, "N m", 0, 1)}
"""


@pytest.fixture(autouse=True)
def _own_effects_end_with_the_test() -> Iterator[None]:
    before = set(registry._EFFECTS)
    yield
    for name in set(registry._EFFECTS) - before:
        unregister(name)


def loaded(folder: Path, text: str, name: str = "mine") -> OwnEffect:
    """The effect from a file with this text under the usual imports."""
    (folder / "my_effects.py").write_text(HEAD + text)
    return load_effect(f"my_effects.py:{name}", folder)


def motion(*effects: str, base: str = "play") -> Trajectory:
    """A motion of that model; the step is fixed so that two models are held against each other sample by sample."""
    return build_model(base, effects).simulate(MOTION, TIMES, substep_s=1.25e-4)


MINE = '@effect("{where}", parameters={{{parameters}}}{more})\ndef mine({arguments}):\n    {body}\n'


@pytest.mark.parametrize(
    ("where", "parameters", "arguments", "body", "twin"),
    [
        ("joint", '"tau_c": Parameter(3e-4, "N m", 0, 1)', "omega, tau_c", "return -tau_c * math.tanh(omega / 5e-3)",
         "coulomb_friction"),
        ("joint", '"mu": Parameter(0.05, "", 0, 1)', "load, omega, mu, R2",
         "return -mu * abs(load) * R2 * math.tanh(omega / 5e-3)", "load_dependent_friction"),
        ("oscillator", '"k3": Parameter(2e9, "N/m^3", 0, 1e12)', "q, k3", "return -k3 * q**3", "hardening_spring"),
        ("sensor", '"c": Parameter(1.0, "m/s^3", -9, 9)', "time, c", "return 0.01 * c * time", "bias_drift"),
        ("contact", '"e": Parameter(1e-5, "m", 0, 1e-3)', "theta_1, e", "return e * math.sin(12 * theta_1)",
         "gear_eccentricity"),
    ],
)  # fmt: skip
def test_same_numbers_as_the_catalogue(
    tmp_path: Path, where: str, parameters: str, arguments: str, body: str, twin: str
) -> None:
    """An effect written anew moves the model as the catalogue's does, compiled, the rate of the gap included."""
    text = MINE.format(where=where, parameters=parameters, arguments=arguments, body=body, more="")
    assert loaded(tmp_path, text).note is None
    expected, plain = motion(twin)["accel"], motion()["accel"]
    assert motion("mine")["accel"] == pytest.approx(expected, abs=1e-6 * np.ptp(plain))
    assert np.max(np.abs(expected - plain)) > 1e-5 * np.ptp(plain)


def test_command_gets_its_rate_too(tmp_path: Path) -> None:
    """An angle on top of the command, that of a second motion: the gears also meet at the speed that belongs to it."""
    text = MINE.format(where="command", parameters='"a": Parameter(0.02, "rad", 0, 1)', arguments="time, a",
                       body="return a * math.sin(40 * time)", more="")  # fmt: skip
    loaded(tmp_path, text)

    class Both:
        def position(self, t: np.ndarray) -> np.ndarray:
            return MOTION.position(t) + 0.02 * np.sin(40 * t)

        def velocity(self, t: np.ndarray) -> np.ndarray:
            return MOTION.velocity(t) + 0.8 * np.cos(40 * t)

        def acceleration(self, t: np.ndarray) -> np.ndarray:
            return MOTION.acceleration(t) - 32 * np.sin(40 * t)

    start = build_model("play").initial_state(Both())
    expected = build_model("play").simulate(Both(), TIMES, start, substep_s=1.25e-4)["accel"]
    found = build_model("play", ["mine"]).simulate(MOTION, TIMES, start, substep_s=1.25e-4)["accel"]
    assert found == pytest.approx(expected, abs=1e-6 * np.ptp(expected))


def test_own_state(tmp_path: Path) -> None:
    """A Maxwell damper whose state begins at zero: a joint coasting against it slows as the closed form says."""
    text = MINE.format(where="joint", parameters='"b": Parameter(4e-4, "N m s/rad", 0, 1)', arguments="omega, z, b",
                       body="return -b * (omega - z), (omega - z) / 0.02", more=', states=["z"]')  # fmt: skip
    loaded(tmp_path, text)
    model = build_model("joint", ["mine"])
    found = model.simulate(None, TIMES, model.initial_state(None, omega_2=1.0), substep_s=1e-4)["velocity"]
    rate = 4e-4 / 2e-4 + 1 / 0.02
    assert found == pytest.approx(1 - 2.0 * (1 - np.exp(-rate * TIMES)) / rate, abs=1e-9)


def test_plain_python_gives_the_same(tmp_path: Path) -> None:
    """A function that numba cannot compile runs as it is, with a note that says why, and gives the same motion."""
    body = "return -tau * {0: math.tanh}[0](omega / 5e-3)"
    effect = loaded(tmp_path, f"@effect('joint', parameters=TAU)\ndef mine(omega, tau):\n    {body}\n")
    assert effect.note is not None
    assert "numba cannot compile it" in effect.note
    expected = build_model("play", ["coulomb_friction"], {"coulomb_friction.tau_c": 2e-4})
    assert motion("mine")["accel"] == pytest.approx(
        expected.simulate(MOTION, TIMES, substep_s=1.25e-4)["accel"], abs=1e-9
    )


def test_what_a_function_raises_on_the_way_is_told(tmp_path: Path) -> None:
    """A function that gives up within the motion stays Python, and its own words come out; the next run is clean."""
    body = "if time > 0.1: raise ValueError('too late')\n    return -tau * omega"
    loaded(tmp_path, f"@effect('joint', parameters=TAU)\ndef mine(time, omega, tau):\n    {body}\n")
    model = build_model("play", ["mine"])
    with pytest.raises(ModelError, match=r"mine: its function raised ValueError\('too late'\)"):
        model.simulate(MOTION, TIMES)
    assert np.all(np.isfinite(model.simulate(MOTION, TIMES[:50])["accel"]))


def test_a_function_that_wants_to_end_the_program_is_told(tmp_path: Path) -> None:
    """SystemExit within the motion is the effect's error, and no end of the program."""
    body = "if time > 0.1: raise SystemExit(0)\n    return -tau * omega"
    loaded(tmp_path, f"@effect('joint', parameters=TAU)\ndef mine(time, omega, tau):\n    {body}\n")
    with pytest.raises(ModelError, match=r"mine: its function raised SystemExit\(0\)"):
        build_model("play", ["mine"]).simulate(MOTION, TIMES)


def test_what_compiled_code_raises_is_no_number(tmp_path: Path) -> None:
    """A table that is read beyond its end within the motion ends the simulation, instead of counting as 0."""
    body = "return -tau * [1.0, 2.0][int(20 * time) if 0 < time < 1 else 0]"
    effect = loaded(tmp_path, f"@effect('joint', parameters=TAU)\ndef mine(time, tau):\n    {body}\n")
    assert effect.note is None
    with pytest.raises(ModelError, match="exceeds all numbers"):
        motion("mine")


def test_ctrl_c_in_a_python_effect_ends_the_simulation(tmp_path: Path) -> None:
    """The signal arrives inside the solver's machine code, and is not lost there."""
    body = "armed and signal.raise_signal(signal.SIGINT)\n    return -tau * omega"
    effect = loaded(
        tmp_path, f"import signal\narmed = []\n@effect('joint', parameters=TAU)\ndef mine(omega, tau):\n    {body}\n"
    )
    effect.declared.function.__globals__["armed"].append(True)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            motion("mine")
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("where", [0.0, 0.5])
def test_motion_with_a_steep_friction_is_right(tmp_path: Path, where: float) -> None:
    """A joint that a tight spot catches moves as Radau integrates it, to 1e-5 of the 1.2 rad that it moves without."""
    load_effect(str(EXAMPLE) + ":tight_spot")
    given = {"tau_t": 5e-3, "width": 0.3, "where": where}
    model = build_model("joint", ["tight_spot"], {f"tight_spot.{name}": value for name, value in given.items()})
    found = model.simulate(None, TIMES, model.initial_state(None, omega_2=3.0))

    def slope(_: float, x: tuple[float, float]) -> tuple[float, float]:
        torque = -5e-3 * math.tanh(x[1] / 0.01) * math.exp(-(((x[0] - where) / 0.3) ** 2))
        return x[1], torque / model.parameters["J"].value

    exact = solve_ivp(slope, (0, TIMES[-1]), [0, 3], "Radau", TIMES, rtol=1e-9, atol=1e-12)
    assert found["position"] == pytest.approx(exact.y[0], abs=1e-5)
    assert abs(found["velocity"][-1]) < 0.1  # it was caught in the spot


@pytest.mark.parametrize(
    ("law", "least", "most"),
    [
        ("math.tanh(omega / 0.01)", 2000, 10_000),
        ("((omega > 0) - (omega < 0))", 2000, 10_000),
        ("math.tanh((omega - 1) / 0.01)", 20_000, 40_000),
    ],
)
def test_steps_are_short_only_where_friction_changes_its_sign(tmp_path: Path, law: str, least: int, most: int) -> None:
    """A joint of 0.01 kg m² that is shaken for 2 s asks for its dry friction of 0.1 N m some 8000 times; with the steps
    that the change of sign needs it was 32 000 times, and 255 000 where it is a jump.  What is steepest at another
    speed has such steps everywhere."""
    text = f"""calls = []
@effect('joint', parameters=TAU)
def mine(omega, tau):
    assert calls.append(0) is None
    return -tau * {law}
"""
    calls = loaded(tmp_path, text).declared.function.__globals__["calls"]
    model = build_model("joint", ["mine"], {"J": 0.01, "mine.tau": 0.1})
    times = np.arange(0, 2, 0.01)
    model.simulate(Sine(3.0, 1.0), times)
    calls.clear()
    model.simulate(Sine(3.0, 1.0), times)
    assert least < len(calls) < most


def test_bases_are_those_that_have_what_it_needs(tmp_path: Path) -> None:
    """Whoever reads the gap acts on play alone; a force on the bar acts wherever there is one."""
    tau = "@effect('{}', parameters=TAU{})\ndef mine({}, tau):\n    return tau * {}\n"
    assert loaded(tmp_path, tau.format("joint", "", "omega", "omega")).bases == ("play", "joint", "servo")
    assert loaded(tmp_path, tau.format("joint", "", "gap", "gap")).bases == ("play",)
    assert loaded(tmp_path, tau.format("joint", "", "kt", "kt")).bases == ("servo",)
    assert loaded(tmp_path, tau.format("oscillator", "", "q", "q")).bases == ("play", "oscillator")
    assert loaded(tmp_path, tau.format("joint", ", bases=['joint']", "omega", "omega")).bases == ("joint",)


def test_edited_file_takes_the_place_of_the_old(tmp_path: Path) -> None:
    """The same file read again after a change gives the new effect, not the old one and no complaint."""
    text = "@effect('joint', parameters=TAU)\ndef mine(omega, tau):\n    return -tau * omega * {}\n"
    loaded(tmp_path, text.format(1))
    soft = motion("mine")["velocity"]
    loaded(tmp_path, text.format(50))
    assert np.max(np.abs(motion("mine")["velocity"] - soft)) > 1e-3


def test_model_travels_without_the_file(tmp_path: Path) -> None:
    """A pickled model brings its effects' text along: it moves the same where neither file nor effect is known."""
    loaded(tmp_path, "@effect('joint', parameters=TAU)\ndef mine(omega, tau):\n    return -tau * math.tanh(omega)\n")
    model = build_model("play", ["mine", "gravity_torque"], {"mine.tau": 1e-3})
    expected = model.simulate(MOTION, TIMES)
    sent = pickle.dumps((model, expected))
    (tmp_path / "my_effects.py").unlink()
    unregister("mine")
    there, trajectory = pickle.loads(sent)
    assert there == model
    np.testing.assert_array_equal(there.simulate(MOTION, TIMES)["accel"], expected["accel"])
    np.testing.assert_array_equal(trajectory["accel"], expected["accel"])


GOOD = "@effect('joint', parameters=TAU)\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def mine(omega, tau)\n    return 1\n", "my_effects.py, line 5: no valid Python: expected ':'"),
        ("import nowhere\n", "line 5: ModuleNotFoundError: No module named 'nowhere'; expected only imports"),
        ("1 / 0\n", "line 5: ZeroDivisionError: division by zero"),
        ("raise SystemExit(3)\n", "line 5: SystemExit: 3"),
        ("raise BaseException('no more')\n", "line 5: BaseException: no more"),
        (GOOD + "def mine(omega, tau):\n    raise GeneratorExit\n", "mine: raised GeneratorExit: , at omega = 0"),
        ("def mine(omega, tau):\n    return 1.0\n", "mine is a plain function, expected @effect(…) above it"),
        (GOOD + "def other(omega, tau):\n    return -tau\n", "there is no function mine; expected one of other"),
        ("", "there is no function mine; expected one of none: no function in this file is decorated with @effect"),
        ("@effect('joints', parameters=TAU)\ndef mine(omega, tau):\n    return 1.0\n",
         "mine: acts_on is 'joints', expected one of joint, oscillator, command, contact, sensor"),
        ("@effect('joint', parameters={})\ndef mine(omega):\n    return 1.0\n", "mine: found no parameters"),
        ("@effect('joint', parameters={'tau': 0.1})\ndef mine(omega, tau):\n    return 1.0\n",
         "parameter tau is 0.1, expected Parameter(start, unit, low, high)"),
        ("@effect('joint', parameters={'tau': Parameter(0.1, 'N m')})\ndef mine(omega, tau):\n    return 1.0\n",
         "parameter tau has no bounds"),
        ("@effect('joint', parameters={'tau': Parameter()})\ndef mine(omega, tau):\n    return 1.0\n",
         "line 5: TypeError: Parameter.__init__() missing 1 required positional argument: 'value'"),
        ("@effect('joint', parameters={'tau': Parameter(3, 'N m', 0, 1)})\ndef mine(omega, tau):\n    return 1.0\n",
         "line 5: 3 lies outside its own bounds 0 to 1 N m"),
        ("@effect('joint', parameters={'gap': Parameter(3, 'm', 0, 9)})\ndef mine(gap):\n    return 1.0\n",
         "parameter gap has the name of a signal"),
        (GOOD + "def mine(omega):\n    return 1.0\n", "tau is declared but is no argument"),
        (GOOD + "def mine(omgea, tau):\n    return tau\n", "neither a parameter nor a signal; did you mean omega?"),
        (GOOD + "def mine(tau, *rest):\n    return 1.0\n", "found the argument *rest, expected plain names"),
        (GOOD + "def mine(tau, acceleration):\n    return 1.0\n",
         "reads acceleration, which follows from a torque on the joint"),
        (GOOD + "def mine(tau, kt, R1):\n    return 1.0\n", "no base has all that it acts on and reads: tau, kt, R1"),
        ("@effect('joint', parameters=TAU, bases='oscillator')\ndef mine(omega, tau):\n    return 1.0\n",
         "bases are ('oscillator',), expected some of play, joint, servo"),
        ("@effect('contact', parameters=TAU, states=['z'])\ndef mine(z, tau):\n    return z, tau\n",
         "acts on the contact and has states, expected none there"),
        (GOOD + "def coulomb_friction(omega, tau):\n    return 1.0\n",
         "coulomb_friction: the catalogue has an effect of that name"),
        (GOOD + "class mine:\n    pass\n", "expected a function with a name"),
        (GOOD + "def mine(omega, tau):\n    pass\n", "returned None, expected a number, at omega = 0, tau"),
        (GOOD + "def mine(omega, tau):\n    if omega >= 0: return -tau\n", "returns nothing on some branch (None)"),
        ("import numpy as np\n" + GOOD + "def mine(omega, tau):\n    return np.zeros(3) * tau\n",
         "returned an array of shape (3,), expected a number"),
        (GOOD + "def mine(omega, tau):\n    return math.nan\n", "returned nan, expected a finite number"),
        (GOOD + "def mine(omega, tau):\n    return (-1.5) ** tau\n", "returned complex"),
        (GOOD + "def mine(omega, tau):\n    return tau / omega\n",
         "raised ZeroDivisionError: float division by zero, at omega = 0, tau = 0.0002"),
        ("@effect('joint', parameters=TAU, states=['z'])\ndef mine(omega, z, tau):\n    return -tau * z\n",
         "expected 2 numbers: the contribution and each state's derivative"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    """The line names the file or the function, what was found and what was expected; nothing stays registered."""
    with pytest.raises(EffectFileError) as caught:
        loaded(tmp_path, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert registry.find("mine") is None


def test_missing_file_and_function(tmp_path: Path) -> None:
    """No file, a file that is no text, and a file without a function's name."""
    with pytest.raises(EffectFileError, match=r"none.py: cannot be read: No such file"):
        load_effect("none.py:mine", tmp_path)
    (tmp_path / "binary.py").write_bytes(b"\xff\xfe")
    with pytest.raises(EffectFileError, match="no UTF-8 text"):
        load_effect("binary.py:mine", tmp_path)
    with pytest.raises(EffectFileError, match="/dev/zero: found more than 1000000 characters; expected a Python file"):
        load_effect("/dev/zero:mine")
    with pytest.raises(EffectFileError, match=r"names no function, expected .*:FUNCTION with one of tight_spot"):
        load_effect(str(EXAMPLE))


def test_step_follows_the_load(tmp_path: Path) -> None:
    """A damper that grows with the load needs a finer step the harder the joint is pushed."""
    text = MINE.format(where="joint", parameters='"mu": Parameter(0.2, "", 0, 1)', arguments="load, omega, mu",
                       body="return -200 * mu * abs(load) * math.tanh(omega / 2)", more="")  # fmt: skip
    loaded(tmp_path, text)
    gentle, hard = (
        build_model("joint", ["mine"]).simulate(Sine(3.0, torque), TIMES).substep_s for torque in (1e-3, 0.1)
    )
    assert hard <= gentle / 32


def test_where_an_effect_has_no_value_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The warning names the effect and the values of the state; a motion that comes there is refused in one line."""
    (tmp_path / "root.py").write_text(
        "import math\nfrom lostmotion.lab import Parameter, effect\n\n"
        "@effect('joint', parameters={'c': Parameter(0.01, 'N m', 0, 1)})\n"
        "def root(omega, c):\n    return -c * math.sqrt(omega) if omega >= 0 else math.nan\n"
    )
    (tmp_path / "model.toml").write_text('base = "joint"\neffects = ["root.py:root"]\n')
    (tmp_path / "plain.toml").write_text('base = "joint"\neffects = ["viscous_friction"]\n')
    model, plain, file = (str(tmp_path / name) for name in ("model.toml", "plain.toml", "motion.csv"))
    motion = ("--motion", "chirp:0.5,2,10,0.01", "--duration", "10", "--rate-hz", "100", "--noise", "1e-5")
    made = CliRunner().invoke(cli, ["simulate", plain, "-o", file, *motion])
    assert made.exit_code == 0, made.output
    told = CliRunner().invoke(cli, ["lab", "compare", model, file])
    assert told.exit_code == 2
    assert "root: returned nan, expected a finite number, at omega = -2.83, c = 0.01" in caplog.text
    assert "so it is wherever omega was -2.83 to -0.085" in caplog.text
    assert re.search(r"found no finite torque of root with theta = \S+, omega = -0\.\d+, expected one", told.stderr)


def test_only_the_effect_that_was_asked_for_is_registered(tmp_path: Path) -> None:
    """Others of its file are not tried by a search; two of one file that were both asked for are."""
    one, other = (
        f"@effect('joint', parameters=TAU)\ndef {name}(omega, tau):\n    return -tau * omega\n" for name in "ab"
    )
    (tmp_path / "two.py").write_text(HEAD + one.replace("def a", "def mine_a") + other.replace("def b", "def mine_b"))
    first = load_effect("two.py:mine_a", tmp_path)
    assert registry.find("mine_b") is None
    second = load_effect("two.py:mine_b", tmp_path)
    assert registry.find("mine_a") is first
    assert registry.find("mine_b") is second
    for name in ("mine_a", "mine_b"):
        unregister(name)
