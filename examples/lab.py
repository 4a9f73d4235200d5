"""The lab in a script; editors and notebooks run its cells (# %%) one by one.  docs/lab.md explains it."""

# %% Three recordings of a servo whose bearing rubs; yours come from read_recording("rec1.csv")
import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab import build_model, compare, experiments, explain, fit, ladder_of, open_executor, write_report
from lostmotion.model import HandWaved, Parameter

rng = np.random.default_rng(0)
servo = build_model("servo", ["viscous_friction", "coulomb_friction"], {"coulomb_friction.tau_c": 0.15})
times = np.arange(0.0, 6.0, 0.01)
recordings = []
for seed in (1, 2, 3):
    motion = servo.simulate(HandWaved(seed), times)
    position = motion["position"] + 5e-4 * rng.standard_normal(times.size)
    recordings.append(Recording(times, {"command": motion["command"], "position": position}, name=f"wave {seed}"))

# %% A model that does not know of it; the torque constant is in the data sheet
model = build_model("servo", ["viscous_friction"], {"kt": Parameter(1.2, "N m/A", fixed=True)})
held = experiments(model, recordings)
before = compare(model, held)
print(f"as it stands: fit {before.fit_percent('position'):.1f} %")

# %% Fitted, then asked what is missing: the last recording judges
with open_executor() as pool:
    fitted = fit(model, held[:2], pool)
    found = explain(model, held, pool)
for estimate in fitted.estimates:
    print(f"{estimate.name} = {estimate.value:.4g} ({estimate.low:.4g} to {estimate.high:.4g}) {estimate.unit}")
print(found.verdict, ", ".join(found.missing), found.advice)

# %% The error falls; all of it as a page to open in a browser
ladder = ladder_of(found)
for rung in ladder.rungs:
    print(f"{', '.join(rung.effects)}: {rung.rms:.2g} {rung.unit}, noise {rung.noise:.2g}")
write_report("lab.html", comparison=compare(found.best.model, held), ladder=ladder)
