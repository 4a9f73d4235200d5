// The lab's first page: recordings and a model are chosen, a run begins.
import { ask, element, say } from "./common.js";
import { bytes, describe, moment, send } from "./labshared.js";

const get = (id) => document.getElementById(id);
const form = get("ask"), chosen = new Set(JSON.parse(sessionStorage.getItem("recordings") ?? "[]"));

function pick(kept) {
  const box = element("input", { type: "checkbox", name: "recording", value: kept.name, checked: chosen.has(kept.name) });
  box.addEventListener("change", () => {
    box.checked ? chosen.add(kept.name) : chosen.delete(kept.name);
    remember();
  });
  const away = element("button", { type: "button", class: "quiet", "aria-label": `Remove ${kept.name}` }, "Remove");
  away.addEventListener("click", async () => {
    if (!confirm(`Remove the recording ${kept.name}?`)) return;
    await attempt(get("files-answer"), () => ask(`/api/lab/recordings/${encodeURIComponent(kept.name)}/remove`, {}));
    chosen.delete(kept.name);
    load();
  });
  const link = element("a", { href: `/api/lab/recordings/${encodeURIComponent(kept.name)}`, "aria-label": `Download ${kept.name}` }, "Download");
  return element("li", {}, element("label", {}, box, element("span", {}, element("strong", {}, kept.name),
    element("small", {}, `${kept.columns.join(", ")}; ${bytes(kept.size)}; ${moment(kept.modified)}`))),
    element("span", { class: "actions" }, link, away));
}

const remember = () => sessionStorage.setItem("recordings", JSON.stringify([...chosen]));

async function load() {
  try {
    const found = await ask("/api/lab");
    for (const name of chosen) if (!found.recordings.some((kept) => kept.name === name)) chosen.delete(name);
    get("recordings").replaceChildren(...found.recordings.map(pick));
    get("no-recordings").hidden = found.recordings.length > 0;
    get("judge").hidden = found.recordings.length < 2;
    get("runs").replaceChildren(...found.runs.map(row));
    get("no-runs").hidden = found.runs.length > 0;
    get("running").hidden = !found.running;
    if (found.running) get("running-link").href = `/lab/runs/${found.running}`;
    say("");
  } catch (error) { say(error.message); }
  document.body.dataset.loaded = "yes";
}

function row(run) {
  return element("li", { "data-state": run.state },
    element("a", { href: `/lab/runs/${run.id}` }, describe(run)),
    element("small", {}, `${run.about.recordings.join(", ")}; ${moment(run.created)}; ${run.state}`));
}

async function attempt(answer, act) {
  try { return await act(); } catch (error) { answer.textContent = error.message; throw error; }
}

async function bring(files) {
  const answer = get("files-answer"), most = Number(form.dataset.most), troubles = [];
  let run = "";
  for (const file of files) {
    if (file.size > most) { troubles.push(`${file.name}: ${bytes(file.size)} are too much: ${bytes(most)} at most (web.upload_mb)`); continue; }
    answer.textContent = `adding ${file.name} …`;
    try {
      const query = new URLSearchParams({ name: file.name, joint: get("file-joint").value });
      const kept = await send(`/api/lab/recordings?${query}`, file);
      if (!kept.run) chosen.add(kept.name);
      else if (files.length === 1) run = kept.run; // another program's, which is made a recording first
      else (await ended(kept.run)).forEach((name) => chosen.add(name)); // one run at a time
    } catch (error) { troubles.push(error.message.startsWith(file.name) ? error.message : `${file.name}: ${error.message}`); }
  }
  remember();
  answer.textContent = troubles.join("; ");
  if (run) { location.assign(`/lab/runs/${run}`); return; }
  get("files").value = "";
  load();
}

// The recordings that a run has made, once it has ended and another may begin.
async function ended(id) {
  while ((await ask("/api/lab")).running === id) await new Promise((next) => setTimeout(next, 300));
  const run = await ask(`/api/lab/runs/${id}`);
  if (run.state !== "done") throw new Error((run.text || run.state).replace(/^given-/, ""));
  return run.about.recordings;
}

get("files").addEventListener("change", (event) => bring([...event.target.files]));
const drop = get("drop");
for (const name of ["dragenter", "dragover"]) drop.addEventListener(name, (event) => { event.preventDefault(); drop.classList.add("over"); });
for (const name of ["dragleave", "drop"]) drop.addEventListener(name, () => drop.classList.remove("over"));
drop.addEventListener("drop", (event) => { event.preventDefault(); bring([...event.dataTransfer.files]); });

function suggest() {
  const base = form.querySelector('input[name="base"]:checked').value;
  get("model").value = `base = "${base}"\neffects = []\n\n[parameters]\n`;
}

form.querySelectorAll('input[name="base"]').forEach((radio) => radio.addEventListener("change", suggest));
get("model-file").addEventListener("change", async (event) => {
  const [file] = event.target.files;
  if (!file) return;
  if (file.size > 100000) { get("ask-answer").textContent = "This is too large for a model file."; return; }
  get("model").value = await file.text();
});

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const answer = get("ask-answer"), kind = event.submitter?.value ?? "explain";
  // The newest comes last: it is the one that judges.
  const recordings = [...form.querySelectorAll('input[name="recording"]:checked')].map((box) => box.value).reverse();
  if (!recordings.length) { answer.textContent = "Choose a recording first."; return; }
  const own = [...form.querySelectorAll('input[name="own"]:checked')].map((box) => box.value);
  answer.textContent = "beginning …";
  try {
    const { id } = await ask("/api/lab/runs", { kind, recordings, model: get("model").value, own });
    location.assign(`/lab/runs/${id}`);
  } catch (error) { answer.textContent = error.message; }
});

get("record")?.addEventListener("click", async () => {
  const answer = get("record-answer");
  answer.textContent = "beginning …";
  try { location.assign(`/lab/runs/${(await ask("/api/lab/record", { joint: get("joint").value, seconds: Number(get("seconds").value) })).id}`); }
  catch (error) { answer.textContent = error.message; }
});

// What another run was asked, to be asked anew.
async function from(run, file) {
  const api = `/api/lab/runs/${encodeURIComponent(run)}`;
  try {
    const { about } = await ask(api);
    chosen.clear();
    about.recordings.forEach((name) => chosen.add(name));
    if (!about.base) return;
    form.querySelectorAll('input[name="base"]').forEach((radio) => { radio.checked = radio.value === about.base; });
    form.querySelectorAll('input[name="own"]').forEach((box) => { box.checked = about.own.includes(box.value); });
    get("model").value = await (await fetch(`${api}/files/${file === "improved.toml" ? file : "model.toml"}`)).text();
    get("model-details").open = true;
  } catch (error) { get("ask-answer").textContent = error.message; }
}

addEventListener("pageshow", (event) => { if (event.persisted) load(); });
suggest();
const query = new URLSearchParams(location.search);
(query.has("from") ? from(query.get("from"), query.get("file")) : Promise.resolve()).then(load);
