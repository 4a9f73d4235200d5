// What the lab's pages share: words and units for people.

const csrf = document.querySelector('meta[name="csrf"]').content;

export const bytes = (count) => count < 1e3 ? `${count} bytes` : count < 1e6 ? `${(count / 1e3).toPrecision(3)} kB` : `${(count / 1e6).toPrecision(3)} MB`;
export const moment = (seconds) => new Date(1000 * seconds).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
// As times.span of daemon/commands; no run takes days.
export function duration(seconds) {
  const [unit, length] = [["h", 3600], ["min", 60]].find(([, one]) => seconds >= 2 * one) ?? ["s", 1];
  return `${Math.round(seconds / length)} ${unit}`;
}

// Where a unit of the format is not one that people read.
export function shown(unit) {
  if (unit === "rad") return { unit: "°", factor: 180 / Math.PI };
  if (unit === "m") return { unit: "mm", factor: 1000 };
  return { unit: unit.replace("^2", "²").replace("^3", "³"), factor: 1 };
}

export const sentence = (text) => text[0].toUpperCase() + text.slice(1);
export const scaled = (values, factor) => values.map((v) => v == null ? null : v * factor);
export const withUnit = (value, unit) => `${short(value)}${unit === "°" ? "" : " "}${unit}`.trim();
export const figure = (value, unit) => {
  if (value == null || !isFinite(value)) return "–";
  const { factor, unit: name } = shown(unit);
  return withUnit(value * factor, name);
};

export const short = (value, digits = 3) => value == null ? "–" : Number(value.toPrecision(digits)).toString().replace("-", "−");

export function describe(run) {
  const { kind, base, effects, added = [], names = {} } = run.about;
  if (kind === "import") return `A recording out of ${run.about.file}`;
  if (kind === "record") return `Recording of ${run.about.joint}`;
  if (added.length) return `With ${added.map((id) => names[id] ?? id).join(" and ")}: what is missing in ${base}?`;
  const model = effects.length ? `${base} with ${effects.join(", ")}` : base;
  return kind === "compare" ? `Where does ${model} fail?` : `What is missing in ${model}?`;
}

// Sends a file as it is.
export async function send(address, file) {
  const answer = await fetch(address, { method: "POST", body: file, headers: { accept: "application/json", "content-type": "application/octet-stream", "x-csrf-token": csrf } });
  if (answer.status === 401) { location.assign("/login"); throw new Error("log in first"); }
  const text = await answer.text();
  let found;
  try { found = JSON.parse(text); } catch { found = { error: text.trim() }; }
  if (!answer.ok) throw new Error(found.error || `status ${answer.status}`);
  return found;
}
