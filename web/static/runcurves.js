// What is left over time, before and after on one scale, and measured and modelled under it.
import { element } from "./common.js";
import { scaled, sentence, shown, withUnit } from "./labshared.js";
import { axis, chart, colour, line, number } from "./plot.js";

const get = (id) => document.getElementById(id);
const NOISE = 1.96; // standard deviations on both sides that hold 95 % of it
const state = { curves: [], which: 0, side: "after", hero: null };

// The stretches of a recording that were fitted one by one, after each other; a gap keeps their lines apart.
function whole(curves) {
  const found = new Map();
  for (const curve of curves) {
    const key = JSON.stringify([curve.recording, curve.column]), before = found.get(key);
    if (!before) { found.set(key, { ...curve }); continue; }
    before.time = before.time.concat((before.time.at(-1) + curve.time[0]) / 2, curve.time);
    for (const of of ["measured", "modelled", "before"]) if (before[of] && curve[of]) before[of] = before[of].concat(null, curve[of]);
  }
  return [...found.values()];
}

// Shows curves as lostmotion lab writes them.
export function pictures(curves) {
  state.curves = whole(curves);
  if (!state.curves.length) return;
  get("curves").hidden = false;
  get("which").replaceChildren(...state.curves.map((curve, i) => element("option", { value: String(i) }, `${curve.recording}, ${curve.what}`)));
  get("which-label").hidden = state.curves.length < 2;
  get("sides").hidden = !state.curves.some((curve) => curve.before);
}

function rms(values) {
  const there = values.filter((v) => v != null);
  return Math.sqrt(there.reduce((sum, v) => sum + v ** 2, 0) / Math.max(there.length, 1));
}

function left(curve, side, factor) {
  const model = side === "before" && curve.before ? curve.before : curve.modelled;
  return curve.measured.map((v, i) => v == null || model[i] == null ? null : (v - model[i]) * factor);
}

export function draw() {
  if (!state.curves.length) return;
  const curve = state.curves[state.which], { unit, factor } = shown(curve.unit);
  const after = left(curve, "after", factor), before = curve.before ? left(curve, "before", factor) : null;
  const values = state.side === "before" && before ? before : after;
  let largest = 0;
  for (const side of [after, before ?? []]) for (const v of side) if (v != null && Math.abs(v) > largest) largest = Math.abs(v);
  const span = 1.08 * Math.max(largest, NOISE * (curve.noise ?? 0) * factor) || 1, noise = curve.noise == null ? 0 : NOISE * curve.noise * factor;
  const hero = chart(get("residual"), {
    scales: { x: { time: false }, y: { range: () => [-span, span] } }, axes: [axis("time (s)"), axis(`measured − modelled (${unit})`)],
    series: [{ label: "time (s)", value: (_, v) => number(v) }, ...(before ? [line("before", state.side === "before" ? "residual" : "noise", { width: state.side === "before" ? 1.3 : 0.6 })] : []),
      ...(before && state.side === "before" ? [] : [line(before ? "after" : "left", "residual", { width: before ? 1.8 : 1.3 })])],
    cursor: { sync: { key: "run", scales: ["x", null] } },
    hooks: { drawClear: [(plot) => floor(plot, noise)], setScale: [zoomed] },
  }, [curve.time, ...(before ? [before] : []), ...(before && state.side === "before" ? [] : [after])], 320);
  chart(get("overlay"), {
    scales: { x: { time: false } }, axes: [axis("time (s)"), axis(`${curve.what} (${unit})`)],
    series: [{ label: "time (s)", value: (_, v) => number(v) }, line("measured", "measured"),
      line("modelled", "modelled", { dash: [6, 3] })],
    cursor: { sync: { key: "run", scales: ["x", null] } }, hooks: { setScale: [zoomed] },
  }, [curve.time, scaled(curve.measured, factor), scaled(state.side === "before" && curve.before ? curve.before : curve.modelled, factor)], 240);
  const told = (v) => withUnit(v, unit), noisy = curve.noise == null ? "" : ` The noise is ${told(curve.noise * factor)}.`;
  get("residual-words").textContent = (before
    ? `${sentence(state.side)}, both on one scale: ${told(rms(before))} before, ${told(rms(after))} after.`
    : `The error is ${told(rms(values))}.`) + noisy;
  get("residual").dataset.side = state.side;
  state.hero = hero;
}

function floor(plot, noise) {
  const { left: x, width } = plot.bbox, a = plot.valToPos(noise, "y", true), b = plot.valToPos(-noise, "y", true);
  plot.ctx.fillStyle = colour("band");
  plot.ctx.fillRect(x, a, width, b - a);
}

// Both plots show the same stretch of time.
let zooming = false;
function zoomed(plot, key) {
  if (key !== "x" || zooming) return;
  zooming = true;
  const { min, max } = plot.scales.x;
  for (const place of ["residual", "overlay"]) {
    const other = get(place).plot;
    if (other && other !== plot && min != null && other.root.isConnected) other.setScale("x", { min, max });
  }
  zooming = false;
}

get("residual").addEventListener("keydown", (event) => {
  const plot = state.hero;
  if (!plot) return;
  const time = state.curves[state.which].time, [first, last] = [time[0], time.at(-1)], { min, max } = plot.scales.x, size = max - min;
  const to = (a, b) => plot.setScale("x", { min: Math.max(a, first), max: Math.min(b, last) });
  const act = { ArrowLeft: () => min > first && to(min - size / 4, max - size / 4), ArrowRight: () => max < last && to(min + size / 4, max + size / 4),
    "+": () => to(min + size / 4, max - size / 4), "=": () => to(min + size / 4, max - size / 4), "-": () => to(min - size / 2, max + size / 2), Home: () => to(first, last) }[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});

get("which").addEventListener("change", (event) => { state.which = Number(event.target.value); draw(); });
document.querySelectorAll('input[name="side"]').forEach((radio) => radio.addEventListener("change", () => { state.side = radio.value; draw(); }));
