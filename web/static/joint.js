// A joint's history and the windows behind it.
import { actOnAlarms, ask, element, listen, showAlarms } from "./common.js";
import { axis, chart, colour, line, number, onTheme, shade, stroke, timeAxis, upright } from "./plot.js";

const root = document.getElementById("joint"), name = root.dataset.joint;
const api = `/api/joints/${encodeURIComponent(name)}`;
const arcMinutes = 60 * 180 / Math.PI;
const QUANTITIES = {
  severity: { label: "severity (arc-minutes)", key: "severity", scale: arcMinutes },
  score: { label: "score", key: "score", scale: 1 },
  play: { label: "play (arc-minutes)", key: "play", scale: arcMinutes },
};
const history = document.getElementById("history");
const state = { of: "severity", span: null, found: null, trend: null, last: "", shown: null, held: null, serial: 0 };

// ---- history

async function load() {
  const serial = ++state.serial;
  history.dataset.state = "loading";
  const pieces = Math.min(Math.max(Math.round(history.clientWidth), 200), 1600);
  const query = new URLSearchParams({ pieces });
  if (state.span) { query.set("since", state.span[0]); query.set("until", state.span[1]); }
  try {
    const found = await ask(`${api}/series?${query}`);
    if (serial !== state.serial) return;
    state.found = found;
    if (!found.columns.severity_high.some((v) => v != null) && state.of === "severity") choose("score");
    drawHistory();
  } catch (error) {
    history.textContent = error.message;
  }
  history.dataset.state = "ready";
}

function choose(of) {
  state.of = of;
  document.querySelector(`input[name="of"][value="${of}"]`).checked = true;
}

function drawHistory() {
  const { found, of } = state, quantity = QUANTITIES[of], columns = found.columns;
  if (!found.first) { history.textContent = "No window has been scored yet."; return; }
  const [low, median, high] = ["low", "median", "high"].map((what) => columns[`${quantity.key}_${what}`].map((v) => v == null ? null : v * quantity.scale));
  const time = columns.time_us.map((t) => t / 1e6);
  const limit = of === "score" ? [...columns.level] : time.map(() => state.trend?.of === of ? state.trend.level * quantity.scale : null);
  const span = state.span ?? [found.first, (found.last === found.first ? found.first + 1 : found.last) + ahead()];
  if (span[1] > found.last) { // the limit goes on, nothing else does
    time.push(span[1]);
    for (const values of [low, median, high]) values.push(null);
    limit.push(limit.at(-1) ?? null);
  }
  // A few windows that are far off do not decide on the scale.
  const most = (values) => values.reduce((a, b) => Math.max(a, b ?? 0), 0), top = Math.max(2 * most(median), most(limit));
  const plot = chart(history, {
    scales: { x: { time: true, range: () => span }, y: { range: (_, a, b) => [Math.min(a ?? 0, 0), Math.min(b ?? 1, top || 1) * 1.08 || 1] } },
    axes: [timeAxis(), axis(quantity.label)],
    series: [{}, line("least", "measured", { width: 0, spanGaps: true }), line("largest", "measured", { width: 0, spanGaps: true }), line("median", "measured", { width: 2, spanGaps: true }), line("limit", "bad", { dash: [7, 5] })],
    bands: [{ series: [2, 1], fill: colour("band") }],
    cursor: { drag: { x: true, y: false, setScale: false } },
    hooks: { draw: [marks], setSelect: [zoom], ready: [clicks] },
  }, [time, low, high, median, limit], 320);
  history.dataset.points = columns.time_us.length;
  history.dataset.until = span[1];
  const count = columns.count.reduce((a, b) => a + b, 0), impacts = columns.impacts.reduce((a, b) => a + b, 0);
  document.getElementById("history-words").textContent = `${count} windows here, ${impacts} with an impact.`;
  return plot;
}

// How far the whole history is drawn beyond its end [s]: until the limit is reached, where that may be soon.
function ahead() {
  const { found, trend, of } = state, most = found.last - found.first;
  if (!trend?.forecast || trend.of !== of || trend.forecast.earliest_s > most) return 0;
  return Math.min(trend.forecast.latest_s ?? most, most);
}

function marks(plot) {
  const { found, trend, of } = state, quantity = QUANTITIES[of];
  const { ctx, bbox } = plot;
  ctx.fillStyle = colour("measured");
  for (const [time] of found.windows) {
    const x = plot.valToPos(time, "x", true);
    if (x >= bbox.left && x <= bbox.left + bbox.width) ctx.fillRect(x - 1, bbox.top + bbox.height - 7 * devicePixelRatio, 2, 7 * devicePixelRatio);
  }
  for (const [time, event] of found.events) upright(plot, time, event === "cleared" ? "good" : event === "acknowledged" ? "soft" : "bad", [2, 4]);
  if (!trend || trend.of !== of) return;
  for (const change of trend.change_points) upright(plot, Date.parse(change) / 1000, "residual", [8, 4]);
  const at = (t) => quantity.scale * (trend.line.intercept + trend.line.slope * (t - trend.line.start));
  const [from, to] = [trend.change_points.at(-1) ?? trend.first, trend.last].map((time) => Date.parse(time) / 1000);
  stroke(plot, "modelled", [], (c) => {
    c.moveTo(plot.valToPos(from, "x", true), plot.valToPos(at(from), "y", true));
    c.lineTo(plot.valToPos(to, "x", true), plot.valToPos(at(to), "y", true));
  });
  if (trend.forecast) {
    const last = Date.parse(trend.last) / 1000;
    shade(plot, last + trend.forecast.earliest_s, last + Math.min(trend.forecast.latest_s ?? 1e10, 1e10), "mask");
  }
}

function zoom(plot) {
  if (plot.select.width < 5) return;
  state.span = [plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x")];
  load();
}

function clicks(plot) {
  let pressed = 0;
  plot.over.addEventListener("mousedown", (event) => { pressed = event.clientX; });
  plot.over.addEventListener("click", (event) => {
    if (Math.abs(event.clientX - pressed) < 5) showWindow(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
  });
  plot.over.addEventListener("dblclick", () => { state.span = null; load(); });
}

function move(share, factor) {
  const { first, last } = state.found, [a, b] = state.span ?? [first, last];
  const middle = (a + b) / 2 + share * (b - a), half = factor * (b - a) / 2;
  state.span = half * 2 >= last - first ? null : [middle - half, middle + half];
  load();
}

history.addEventListener("keydown", (event) => {
  const [a, b] = state.span ?? [state.found?.first, state.found?.last];
  const act = { ArrowLeft: () => move(-0.25, 1), ArrowRight: () => move(0.25, 1), "+": () => move(0, 0.5), "=": () => move(0, 0.5),
    "-": () => move(0, 2), Enter: () => showWindow((a + b) / 2), Home: () => { state.span = null; load(); } }[event.key];
  if (!act || !state.found?.first) return;
  event.preventDefault();
  act();
});

document.querySelectorAll('input[name="of"]').forEach((radio) => radio.addEventListener("change", () => { state.of = radio.value; drawHistory(); }));
document.querySelectorAll("[data-span]").forEach((button) => button.addEventListener("click", () => {
  const length = Number(button.dataset.span), last = state.found?.last;
  state.span = length && last ? [last - length, last] : null;
  load();
}));

// ---- trend

async function loadTrend() {
  const words = document.getElementById("trend");
  try {
    const trend = state.trend = await ask(`${api}/trend`);
    words.replaceChildren(element("dl", { class: "found" },
      ...trend.words.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text)))));
  } catch (error) {
    words.textContent = error.message;
  }
  if (state.found) drawHistory();
}

// ---- windows

async function showWindow(time) {
  const words = document.getElementById("window-words");
  try {
    state.shown = await ask(`${api}/window?time=${time}`);
  } catch (error) {
    words.textContent = error.message;
    return;
  }
  const { picture, score } = state.shown;
  const told = score ? `score ${number(score.score)} (level ${number(score.level)}), quality ${score.quality}` : "its score is not kept any more";
  words.textContent = `${new Date(picture.time).toLocaleString()}: ${picture.is_impact ? "an impact" : "no impact"}; ${told}; ${picture.seconds.length} samples at ${number(picture.rate_hz)} Hz.` + (state.held ? ` Compared with: ${new Date(state.held.picture.time).toLocaleString()}.` : "");
  const link = document.getElementById("download");
  link.href = `${api}/window?time=${encodeURIComponent(picture.time)}&format=csv`;
  link.hidden = false;
  document.getElementById("hold").disabled = false;
  document.getElementById("window-plots").hidden = false;
  drawWindow();
}

// This window and the held one on one axis.
const joined = (a, x, y) => uPlot.join([[a.picture[x], a.picture[y]], ...(state.held ? [[state.held.picture[x], state.held.picture[y]]] : [])]);

function drawWindow() {
  if (!state.shown) return;
  const { picture } = state.shown, held = state.held ? [line("held", "noise", { spanGaps: true })] : [];
  chart(document.getElementById("wave"), {
    scales: { x: { time: false } }, axes: [axis("time (s)"), axis("acceleration (m/s²)")],
    series: [{ label: "time (s)", value: (_, v) => number(v) }, line("this", "measured", { spanGaps: true }), ...held],
  }, joined(state.shown, "seconds", "accel"));
  const commanded = [state.shown, state.held].some((one) => one?.picture.commanded[0].length);
  document.getElementById("commanded-figure").hidden = !commanded;
  if (commanded) {
    const motion = (one) => { const [x, y] = one.picture.commanded; return [x, y.map((angle) => angle * 180 / Math.PI)]; };
    chart(document.getElementById("commanded"), {
      scales: { x: { time: false } }, axes: [axis("time (s)"), axis("angle (°)")],
      series: [{ label: "time (s)", value: (_, v) => number(v) }, line("this", "measured", { spanGaps: true }), ...held],
      hooks: { draw: [(plot) => upright(plot, 0, "modelled", [6, 4])] },
    }, uPlot.join([motion(state.shown), ...(state.held ? [motion(state.held)] : [])]));
  }
  const last = picture.frequency.at(-1), high = Math.max(picture.f_res_hz ?? 0, ...picture.norm.map((band) => band[1]));
  chart(document.getElementById("spectrum"), {
    scales: { x: { time: false, range: () => [0, high ? Math.min(last, 2.2 * high) : last] } }, axes: [axis("frequency (Hz)"), axis("amplitude (m/s²)")],
    series: [{ label: "frequency (Hz)", value: (_, v) => number(v) }, line("this", "measured", { spanGaps: true }), ...held],
    hooks: { drawClear: [(plot) => {
      picture.norm.forEach(([a, b]) => shade(plot, a, b, "band"));
      picture.mask.forEach(([a, b]) => shade(plot, a, b, "mask"));
    }], draw: [(plot) => { if (picture.f_res_hz) upright(plot, picture.f_res_hz, "modelled", [6, 4]); }] },
  }, joined(state.shown, "frequency", "amplitude"));
}

document.getElementById("hold").addEventListener("click", (event) => {
  state.held = state.held ? null : state.shown;
  event.target.textContent = state.held ? "End the comparison" : "Keep it for comparison";
  drawWindow();
});

// ---- news

let waiting = 0;
listen({
  cards(robot) {
    const joint = robot.joints.find((one) => one.joint === name);
    showAlarms(document.getElementById("alarms"), robot.alarms.filter((alarm) => alarm.joint === name));
    if (!joint) return;
    const badge = root.querySelector("h1 .health");
    badge.textContent = badge.dataset.health = joint.health;
    root.querySelector(".why").textContent = `${joint.reason}. Score ${joint.score} (level ${joint.level}), play ${joint.play}, severity ${joint.severity}; last window ${joint.last}.`;
    if (joint.window !== state.last && !state.span && !waiting) {
      waiting = setTimeout(() => { waiting = 0; load(); }, state.last ? 2000 : 60000);
    }
    state.last = joint.window;
  },
});
actOnAlarms(document.getElementById("alarms"));
onTheme(() => { drawHistory(); drawWindow(); });
load().then(loadTrend).then(() => state.found?.last && showWindow(state.found.last));
