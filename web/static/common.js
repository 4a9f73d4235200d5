// What all pages share: asking the server, the news as it comes, the banner.

import { open } from "./source.js";

const csrf = document.querySelector('meta[name="csrf"]').content;

export async function ask(address, body) {
  const options = body === undefined ? {} : {
    method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json", "x-csrf-token": csrf },
  };
  const answer = await fetch(address, { ...options, headers: { accept: "application/json", ...options.headers } });
  if (answer.status === 401) { location.assign("/login"); throw new Error("log in first"); }
  const text = await answer.text();
  let found;
  try { found = JSON.parse(text); } catch { found = { error: text.trim() }; }
  if (!answer.ok && !("answer" in found)) throw new Error(found.error || `status ${answer.status}`);
  return found;
}

export function send(address, form) {
  return fetch(address, { method: "POST", body: form, headers: { accept: "application/json", "x-csrf-token": csrf } });
}

export function say(text) {
  const banner = document.getElementById("banner");
  if (banner.textContent !== text) banner.textContent = text;
  banner.hidden = !text;
}

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("data-") || key.startsWith("aria-") || key === "role" || key === "class") made.setAttribute(key, value);
    else made[key] = value;
  }
  made.append(...children);
  return made;
}

// Listens to the robot's news; a lost connection is said, and found again by the browser.
export function listen(handlers) {
  addEventListener("pageshow", (event) => event.persisted && location.reload());
  const tell = ({ name, data, closed }) => {
    if (name === "trouble") say(data.text);
    else if (name === "error") lost(closed);
    else say("");
    handlers[name]?.(data);
  };
  if (!("SharedWorker" in window)) {
    const source = open(tell);
    addEventListener("pagehide", () => source.close());
    return;
  }
  const { port } = new SharedWorker("/static/news.js", { type: "module", name: "news" });
  port.addEventListener("message", (event) => tell(event.data));
  port.start();
  addEventListener("pagehide", () => port.postMessage("bye"));
}

function lost(closed) {
  say("The connection to this page's server is lost; it is tried again.");
  if (closed) ask("/api/status").then(() => location.reload(), (error) => say(error.message));
}

// The list of alarms and its buttons.
export function showAlarms(root, alarms) {
  const key = JSON.stringify(alarms.map((a) => [a.joint, a.cause, a.severity, a.state, a.reason]));
  if (root.dataset.shown === key) return;
  const focused = root.contains(document.activeElement) ? identity(document.activeElement) : "";
  root.dataset.shown = key;
  root.replaceChildren(element("ul", { class: "alarms plain" }, ...alarms.map(alarmItem)));
  const again = [...root.querySelectorAll("button")].find((button) => identity(button) === focused);
  if (again) again.focus();
}

const identity = (node) => ["verb", "joint", "cause"].map((name) => node.dataset?.[name] ?? "").join("/");

function alarmItem(alarm) {
  const of = { "data-joint": alarm.joint, "data-cause": alarm.cause };
  const button = (verb, text) => element("button", { type: "button", "data-verb": verb, ...of }, text);
  const hours = element("select", { "data-hours": "" },
    ...[["1", "1 h"], ["8", "8 h"], ["24", "1 day"], ["168", "1 week"]].map(([value, text]) =>
      element("option", { value, selected: value === "8" }, text)));
  const actions = element("p", { class: "actions" });
  if (alarm.can_acknowledge) actions.append(button("ack", "Acknowledge"));
  if (alarm.is_shelved) actions.append(button("unshelve", "End the silence"));
  else actions.append(element("label", {}, "Shelve for ", hours), button("shelve", "Shelve"));
  actions.append(element("span", { class: "answer", role: "status" }));
  return element("li", { class: "alarm", "data-severity": alarm.severity },
    element("p", {}, element("strong", {}, alarm.joint), ": ", element("span", { class: "severity" }, alarm.severity),
      `, ${alarm.state}. ${alarm.reason} `, element("small", {}, `(${alarm.since})`)), actions);
}

// One listener for all buttons of alarms, those that come later too.
export function actOnAlarms(root) {
  root.addEventListener("click", async (event) => {
    const button = event.target.closest("button[data-verb]");
    if (!button) return;
    const item = button.closest(".alarm"), answer = item.querySelector(".answer");
    const wish = { joint: button.dataset.joint, verb: button.dataset.verb, cause: button.dataset.cause };
    if (wish.verb === "shelve") wish.for_s = 3600 * Number(item.querySelector("[data-hours]").value);
    button.disabled = true;
    answer.textContent = "asking …";
    try { answer.textContent = (await ask("/api/alarms", wish)).answer; }
    catch (error) { answer.textContent = error.message; }
    finally { button.disabled = false; }
  });
}

document.querySelector("form[data-logout]")?.addEventListener("submit", async (event) => {
  event.preventDefault();
  await send("/logout");
  location.assign("/login");
});
