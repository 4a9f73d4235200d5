// One run of the lab: how far it is, and what it has found.
import { bar, scale } from "./bars.js";
import { ask, element, say } from "./common.js";
import { describe, duration, figure, scaled, sentence, short, shown } from "./labshared.js";
import { axis, chart, colour, line, onTheme } from "./plot.js";
import { draw, pictures } from "./runcurves.js";

const get = (id) => document.getElementById(id);
const root = get("run"), name = root.dataset.run, api = `/api/lab/runs/${name}`;
const state = { job: null, found: null, maps: null, shape: null };

// ---- progress

let source = null, clock = 0;

function follow() {
  if (source || document.hidden) return;
  source = new EventSource(`${api}/events`);
  source.addEventListener("run", (event) => { say(""); take(JSON.parse(event.data)); });
  source.addEventListener("error", () => {
    say("The connection to this page's server is lost; it is tried again.");
    if (source?.readyState === EventSource.CLOSED) leave();
  });
}

function leave() {
  source?.close();
  source = null;
}

document.addEventListener("visibilitychange", () => document.hidden ? leave() : state.job?.state === "running" && follow());
addEventListener("pagehide", leave);

function take(job) {
  state.job = job;
  root.dataset.state = job.state;
  const title = get("title").textContent = describe(job);
  document.title = `${title} · lostmotion`;
  const about = job.about, model = about.base ? `; base ${about.base}; effects: ${about.effects.join(", ") || "none"}` : "";
  get("about").textContent = about.recordings.join(", ") + model;
  const goes = job.state === "running";
  get("going").hidden = !goes;
  clearInterval(clock);
  if (goes) {
    const last = job.progress.at(-1);
    get("doing").textContent = last ? `${last.progress} …` : { compare: "comparing …", record: "recording …", import: "reading …" }[about.kind] ?? "beginning …";
    get("bar").value = last?.part ?? 0;
    if (!last?.part) get("bar").removeAttribute("value");
    get("steps").replaceChildren(...job.progress.slice(0, -1).map((one) => element("li", {}, one.progress)));
    const tick = () => {
      const gone = Math.max(0, Date.now() / 1000 - job.created);
      get("elapsed").textContent = `for ${duration(gone)}${about.seconds ? ` of ${duration(about.seconds)}` : ""}`;
      if (about.seconds) get("bar").value = gone / about.seconds;
    };
    tick();
    clock = setInterval(tick, 1000);
    if (about.rungs?.length) ladder(null);
    follow();
    return;
  }
  leave();
  get("trouble").hidden = job.state === "done";
  get("trouble").textContent = job.text || job.state;
  if (job.state === "done" && !state.found) result();
}

get("stop").addEventListener("click", async (event) => {
  event.target.disabled = true;
  try { take(await ask(`${api}/stop`, {})); } catch (error) { say(error.message); }
  event.target.disabled = false;
});

get("remove").addEventListener("click", async () => {
  try { await ask(`${api}/remove`, {}); location.assign("/lab"); } catch (error) { say(error.message); }
});

// ---- what was found

async function result() {
  let curves;
  try {
    const files = state.job.files.includes("curves.json") ? ["result.json", "curves.json"] : ["result.json"];
    [state.found, curves = []] = await Promise.all(files.map((file) => ask(`${api}/files/${file}`)));
  } catch (error) { say(error.message); return; }
  const { found } = state;
  if (!state.job.about.base) { recorded(found); return; }
  verdict(found);
  if (found.ladder) { ladder(found); ranking(found); parameters(found); }
  else where(found);
  missing(found);
  pictures(curves);
  downloads();
  redraw();
  root.dataset.shown = "yes";
}

function verdict(found) {
  get("words").replaceChildren(...found.words.map((words) => element("p", {}, sentence(words))));
  get("verdict").dataset.tone = found.verdict ?? (found.is_noise ? "nothing_missing" : "missing");
  const look = Object.values(found.look ?? {});
  get("look").hidden = !look.length;
  get("look-list").replaceChildren(...look.map((words) => element("li", {}, words)));
  get("advice").hidden = !found.advice;
  get("advice").textContent = found.advice ?? "";
  get("verdict").hidden = false;
}

// A recording was made: what is in it, and on to the lab with it.
function recorded(found) {
  const { about } = state.job, [name] = about.recordings;
  verdict({ verdict: "nothing_missing", words: about.kind === "record" ? measured(found, about) : imported(found) });
  sessionStorage.setItem("recordings", JSON.stringify([...new Set([...JSON.parse(sessionStorage.getItem("recordings") ?? "[]"), name])]));
  get("again").textContent = "Use it in the lab";
  get("again").href = "/lab";
  root.dataset.shown = "yes";
}

function measured(found, about) {
  const lost = Object.entries(found.losses).filter(([, count]) => count);
  const rates = Object.entries(found.rates).filter(([, rate]) => rate > 0).map(([device, rate]) => `${device} ${short(rate)} Hz`);
  return [`${found.rows} rows in ${short(found.duration)} s of joint ${about.joint}: ${joined(rates)}.`,
    lost.length ? `Not in it: ${joined(lost.map(([kind, count]) => `${count} ${kind}`))}.` : "Nothing was lost on the way."];
}

const imported = (found) => [`${found.rows} rows over ${short(found.duration)} s out of ${found.format}; time: ${found.clock}.`,
  ...found.columns.map((one) => `${one.column} is ${one.series} (${one.unit || `${one.si}, as no unit is given`}; ${one.why}).`), ...found.notes];

const called = (id) => state.found?.names?.[id] ?? state.job.about.names?.[id] ?? id;
const joined = (names) => names.length < 2 ? names.join("") : `${names.slice(0, -1).join(", ")} and ${names.at(-1)}`;
const plain = (effects) => joined(effects.map(called));

function ladder(found) {
  const { about } = state.job, unit = found?.error.unit ?? about.rungs[0].unit;
  const rungs = [...about.rungs, ...(found?.ladder ?? []).map((rung, i) => ({
    ...rung, found: i > 0, added: i ? rung.effects.filter((id) => !found.ladder[i - 1].effects.includes(id)) : about.added,
  }))];
  const { share, note } = scale(rungs.map((rung) => rung.rms), rungs[0].noise);
  const rows = rungs.map((rung, i) => {
    const what = !i ? "The model as it was given" : `${rung.found ? "With" : "Added:"} ${plain(rung.added)}`;
    const title = rung.run ? element("a", { href: `/lab/runs/${rung.run}` }, what) : element("span", {}, what);
    return element("li", { class: rung.found ? "is-found" : "" }, element("span", { class: "what" }, title,
      rung.found ? element("small", {}, " found, not yet added") : ""),
      element("span", { class: "number" }, figure(rung.rms, unit)),
      bar(share(rungs[Math.max(i - 1, 0)].rms), share(rung.rms), share(rung.noise)));
  });
  if (!found) rows.push(element("li", {}, element("span", { class: "what" }, `Added: ${plain(about.added)}`), element("span", { class: "number" }, "…")));
  get("ladder").replaceChildren(...rows);
  get("ladder-scale").textContent = note;
  get("ladder-section").hidden = false;
  get("take").hidden = !found?.missing.length;
  if (!found?.missing.length) return;
  const several = found.missing.length > 1;
  get("add-found").textContent = several ? "Add all of it, and look for more" : `Add ${plain(found.missing)}, and look for more`;
  get("add-found").onclick = () => add(found.missing);
  get("add-first").hidden = !several;
  get("add-first").textContent = `Only ${called(found.missing[0])}`;
  get("add-first").onclick = () => add(found.missing.slice(0, 1));
}

function ranking(found) {
  if (!found.ranking.length) return;
  const { unit, noise } = found.error, isFitted = (one) => one.rms_after !== one.rms_before || found.missing.includes(one.effect);
  const { share, note } = scale(found.ranking.map((one) => one.rms_before), noise);
  const rest = found.ranking.filter((one) => !isFitted(one));
  const row = (one) => {
    const is = found.missing.includes(one.effect), p = one.p_value < 0.003 ? "p < 0.003" : `p = ${short(one.p_value, 2)}`;
    const button = element("button", { type: "button", "aria-label": `Add ${called(one.effect)}` }, "Add");
    button.addEventListener("click", () => add([one.effect]));
    const values = Object.entries(one.parameters).map(([id, [value]]) => `${id} = ${short(value, 4)}`).join(", ");
    const later = is && one.rms_after === one.rms_before ? "found once the others were there" : null;
    const fell = isFitted(one) ? later ?? `${figure(one.rms_before, unit)} → ${figure(one.rms_after, unit)}` : "";
    return element("li", { class: is ? "is-found" : "", "data-effect": one.effect },
      element("span", { class: "what" }, element("strong", {}, sentence(called(one.effect))), element("small", {}, ` ${one.effect}${values ? `: ${values}` : ""}`)),
      element("span", { class: "number" }, fell, element("small", {}, ` ${p}`)),
      isFitted(one) && !later ? bar(share(one.rms_before), share(one.rms_after), share(noise), is ? "good" : "") : "", button);
  };
  get("ranking").replaceChildren(...found.ranking.filter(isFitted).map(row));
  get("unfitted").replaceChildren(...rest.map(row));
  get("unfitted-section").hidden = !rest.length;
  get("unfitted-title").textContent = `${rest.length} more, of which a quick test saw too little to fit them`;
  get("ranking-scale").textContent = note;
  get("seen").replaceChildren(...(found.seen_from ?? []).map((words) => element("li", {}, words)));
  get("seen-section").hidden = !found.seen_from?.length;
  get("ranking-section").hidden = false;
}

async function add(effects) {
  const answer = get("add-answer");
  get("take").hidden = false;
  answer.textContent = "beginning …";
  try { location.assign(`/lab/runs/${(await ask(`${api}/add`, { effects })).id}`); }
  catch (error) { answer.textContent = error.message; answer.scrollIntoView({ block: "center" }); }
}

function parameters(found) {
  const rows = Object.entries(found.parameters);
  get("parameters").replaceChildren(...rows.map(([id, [value, low, high]]) => element("tr", {}, element("td", {}, id),
    element("td", { class: "number" }, short(value, 5)), element("td", { class: "number" }, `${short(low, 4)} to ${short(high, 4)}`))));
  get("parameters-section").hidden = !rows.length;
}

// ---- where it fails

get("explain").addEventListener("click", async (event) => {
  const { recordings, own } = state.job.about;
  event.target.disabled = true;
  try {
    const model = await (await fetch(`${api}/files/model.toml`)).text();
    location.assign(`/lab/runs/${(await ask("/api/lab/runs", { kind: "explain", recordings, model, own })).id}`);
  } catch (error) { get("explain-answer").textContent = error.message; event.target.disabled = false; }
});

function where(found) {
  const [column] = Object.values(found.columns), { unit } = column;
  const row = (what, value, share, most, noise) => element("li", {}, element("span", { class: "what" }, what),
    element("span", { class: "number" }, value), bar(share / most, share / most, noise == null ? null : noise / most));
  const most = Math.max(...column.phases.map((one) => one.error));
  get("phases").replaceChildren(...column.phases.map((one) => row(one.phase, `${Math.round(100 * one.error)} % of it, ${figure(one.rms, unit)}`, one.error, most)));
  const largest = Math.max(...column.bands.map((band) => Math.max(band.residual, band.noise)));
  get("bands").replaceChildren(...column.bands.map((band) => row(`${short(band.low_hz, 2)} to ${short(band.high_hz, 2)} Hz`, figure(band.residual, unit), band.residual, largest, band.noise)));
  const maps = column.maps.filter((map) => map.significant && map.x.length > 1).slice(0, 4);
  get("where").hidden = get("ask-explain").hidden = false;
  get("maps").replaceChildren(...maps.map((map) => {
    const plot = element("div", { class: "chart small", role: "img", "aria-label": `error against ${found.variables[map.variable]}` });
    return element("figure", {}, plot, element("figcaption", {}, `Against ${found.variables[map.variable]}: ${Math.round(100 * map.explained)} % of the error follows it`));
  }));
  state.maps = () => maps.forEach((map, i) => {
    const y = shown(unit), x = shown(map.unit), off = (sign) => map.mean.map((v, k) => v == null ? null : v + sign * map.half_width[k]);
    banded(get("maps").children[i].firstChild, scaled(map.x, x.factor), scaled(map.mean, y.factor), scaled(off(-1), y.factor), scaled(off(1), y.factor),
      `${found.variables[map.variable]} (${x.unit})`, `error (${y.unit})`, 180);
  });
}

function missing(found) {
  const left = found.residual;
  if (!left || (found.ladder && !left.curve)) return; // else the words have said it
  get("missing-words").textContent = `${sentence(left.description)}${/[.!?]$/.test(left.description) ? "" : "."}${left.formula ? ` A short formula that fits: ${left.formula}` : ""}`;
  get("missing").hidden = false;
  get("shape").parentElement.hidden = !left.curve;
  if (!left.curve) return;
  const { curve } = left, x = shown(curve.unit), y = shown(curve.mean_unit ?? ""), people = (values) => scaled(values, y.factor);
  state.shape = () => banded(get("shape"), scaled(curve.x, x.factor), people(curve.mean), people(curve.low), people(curve.high),
    `${found.variables?.[curve.variable] ?? curve.variable} (${x.unit})`, `what is left${y.unit && ` (${y.unit})`}`, 240);
}

function banded(place, x, mean, low, high, across, up, height) {
  const order = x.map((_, i) => i).sort((a, b) => x[a] - x[b]), by = (values) => order.map((i) => values[i]);
  chart(place, {
    scales: { x: { time: false } }, axes: [axis(across), axis(up)], legend: { show: false }, cursor: { show: false },
    series: [{}, line("low", "band", { width: 0 }), line("high", "band", { width: 0 }), line("mean", "residual", { width: 2 })],
    bands: [{ series: [2, 1], fill: colour("band") }],
  }, [by(x), by(low), by(high), by(mean)], height);
}

// ---- to take away

function downloads() {
  const offered = { "improved.toml": "Model file", "report.html": "Report", "model.toml": "Model as it was given", "result.json": "Numbers (JSON)", "curves.json": "Curves (JSON)" };
  const there = Object.entries(offered).filter(([file]) => state.job.files.includes(file));
  get("downloads").replaceChildren(...there.map(([file, text]) => element("a", { class: "button", href: `${api}/files/${file}?download`, "data-file": file }, text)));
  if (state.job.files.includes("improved.toml")) {
    get("downloads").append(element("a", { class: "button", href: `/lab?from=${name}&file=improved.toml` }, "Use this model with other recordings"));
  }
  get("takeaway").hidden = !there.length;
}

function redraw() {
  draw();
  state.maps?.();
  state.shape?.();
}

onTheme(redraw);
ask(api).then(take, (error) => say(error.message));
