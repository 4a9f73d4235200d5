// The page that leads through a calibration.  All it knows is the server's: loaded again, or on a second screen, it is the same.
import { ask, element, say } from "./common.js";
import { axis, chart, colour, line, onTheme, upright } from "./plot.js";

const LOOK_MS = 700, IDLE_MS = 5000, HEIGHT = 256;
const part = (id) => document.getElementById(id);
const show = (id, is) => { if (part(id)) part(id).hidden = !is; };
const write = (id, text) => { if (part(id).textContent !== text) part(id).textContent = text; };
let timer = 0, state = null, drawn = "", digests = {};

function interval(of, digits, unit) {
  if (!of) return "–";
  return `${of.value.toFixed(digits)}${unit} (95 %: ${of.low.toFixed(digits)} to ${of.high.toFixed(digits)})`;
}

function tapsWords(taps, running) {
  if (!taps) return "Listening …";
  if (taps.is_enough) return running ? "That is enough: stop." : "The bar is known well.";
  if (running && taps.taps) return "Go on: more taps make the intervals smaller.";
  return running ? "Listening: flick the bar." : taps.notes[0] || "More taps would tell it better.";
}

function showTaps(found) {
  const taps = found.taps, running = found.step === "taps";
  show("taps", taps || running);
  write("taps-words", tapsWords(taps, running) + (taps?.notes.length && taps.taps >= 3 ? ` ${taps.notes.join(" ")}` : ""));
  write("taps-count", String(taps?.taps ?? 0));
  write("taps-f", interval(taps?.f_res_hz, 3, " Hz"));
  write("taps-zeta", interval(taps?.zeta, 5, ""));
  if (!taps) return;
  const key = JSON.stringify([taps.seconds, taps.taps, found.history.length]);
  if (key !== drawn) { drawn = key; draw(found); }
}

function draw({ taps, history }) {
  const resonance = taps.f_res_hz?.value;
  chart(part("spectrum"), {
    axes: [axis("frequency (Hz)"), axis("amplitude (m/s²)")], scales: { x: { time: false } }, legend: { show: false },
    series: [{}, line("amplitude", "measured")],
    hooks: { draw: [(plot) => resonance && upright(plot, resonance, "modelled", [4, 3])] },
  }, [taps.frequency, taps.amplitude], HEIGHT);
  const of = (key) => history.map((one) => one.f_res_hz[key]);
  chart(part("converge"), {
    axes: [axis("taps", { incrs: [1, 2, 5, 10, 20, 50] }), axis("f_res (Hz)", { size: 64 })], scales: { x: { time: false } }, legend: { show: false },
    series: [{}, line("f_res", "measured", { points: { show: true } }), line("low", "noise"), line("high", "noise")],
    bands: [{ series: [3, 2], fill: colour("band") }],
  }, [history.map((one) => one.taps), of("value"), of("low"), of("high")], HEIGHT);
}

function showMotion(found) {
  const motion = found.motion, running = found.step === "motion";
  show("motion", motion || running);
  show("judging", found.is_judging);
  if (!motion) { write("motion-words", "Waiting for the first windows …"); part("missing").replaceChildren(); return; }
  const brisk = motion.reached === null ? "" : `; the motion reaches ${motion.reached.toPrecision(2)} rad/s²`;
  write("motion-words", `${motion.windows} of ${motion.needed} windows in ${Math.round(motion.seconds)} s${brisk}.`);
  part("motion-progress").value = Math.min(motion.windows / motion.needed, 1);
  const missing = motion.missing.length || !running ? motion.missing : ["Nothing is missing: stop when you like."];
  if (part("missing").innerText !== missing.join("\n")) {
    part("missing").replaceChildren(...missing.map((text) => element("li", {}, text)));
  }
}

function diff(id, change) {
  const kinds = { "+": "added", "-": "removed", "@": "place" };
  const kind = (text, at) => at < 2 ? "place" : kinds[text[0]] ?? "";
  part(id).replaceChildren(...change.diff.map((text, at) => element("span", { class: kind(text, at) }, `${text}\n`)));
}

function showChange(found) {
  part("said").replaceChildren(...found.said.map((text) => element("li", {}, text)));
  if (!part("change")) return;
  const { change, back } = found;
  show("change", change);
  show("nothing", !change);
  show("back", back);
  if (change && change.digest !== digests.change) diff("diff", change);
  if (back && back.digest !== digests.back) diff("back-diff", back);
  digests = { change: change?.digest, back: back?.digest };
}

function showAll(found) {
  const busy = found.step || found.is_judging;
  if (found.joint && (busy || found.taps || found.motion)) part("joint").value = found.joint;
  if (busy) part("rate").value = String(found.false_alarm);
  part("rate").disabled = Boolean(busy);
  state = found;
  part("joint").disabled = Boolean(busy);
  for (const button of document.querySelectorAll("[data-begin]")) button.disabled = Boolean(busy);
  for (const button of document.querySelectorAll("[data-end]")) button.hidden = button.dataset.end !== found.step;
  for (const id of ["write", "forget", "undo"]) if (part(id)) part(id).disabled = Boolean(busy);
  write("trouble", found.trouble);
  show("trouble", found.trouble);
  describe();
  showTaps(found);
  showMotion(found);
  showChange(found);
  document.body.dataset.state = busy ? "busy" : "idle";
}

async function look() {
  clearTimeout(timer);
  try {
    if (!document.hidden) { showAll(await ask("/api/calibrate")); say(""); }
  } catch (error) {
    say(error instanceof TypeError ? "The connection to this page's server is lost; it is tried again." : error.message);
  }
  clearTimeout(timer);
  timer = setTimeout(look, state?.step || state?.is_judging ? LOOK_MS : IDLE_MS);
}

async function act(button, wish) {
  button.disabled = true;
  try { showAll(await ask("/api/calibrate", wish)); say(""); }
  catch (error) {
    button.disabled = false;
    write("trouble", error.message);
    show("trouble", true);
    part("trouble").scrollIntoView({ block: "nearest" });
  }
  clearTimeout(timer);
  timer = setTimeout(look, LOOK_MS);
}

function describe() {
  const chosen = part("joint").selectedOptions[0];
  const [f, zeta] = state?.bar[chosen?.value] ?? [chosen?.dataset.f, chosen?.dataset.zeta];
  if (chosen) write("joint-words", `accelerometer ${chosen.dataset.sensor}; in the file: f_res ${f} Hz, zeta ${zeta}`);
}

for (const button of document.querySelectorAll("[data-begin]")) {
  button.addEventListener("click", () => act(button, { verb: "begin", joint: part("joint").value, step: button.dataset.begin,
    false_alarm: Number(part("rate").value) }));
}
for (const button of document.querySelectorAll("[data-end]")) button.addEventListener("click", () => act(button, { verb: "end" }));
part("write")?.addEventListener("click", (event) => act(event.target, { verb: "write", digest: state.change.digest }));
part("undo")?.addEventListener("click", (event) => act(event.target, { verb: "undo", digest: state.back.digest }));
part("forget")?.addEventListener("click", (event) => act(event.target, { verb: "forget" }));
part("joint").addEventListener("change", describe);
onTheme(() => state?.taps && draw(state));
describe();
look();
