// Keeps the first page up to date.
import { actOnAlarms, element, listen, showAlarms } from "./common.js";

const FIELDS = ["health", "reason", "score", "level", "play", "severity", "last"];
const cards = new Map([...document.querySelectorAll("#joints [data-joint]")].map((card) => [card.dataset.joint, card]));

function show(card, joint) {
  card.dataset.health = joint.health;
  for (const name of FIELDS) {
    const field = card.querySelector(`[data-field="${name}"]`);
    if (field.textContent !== joint[name]) field.textContent = joint[name];
  }
  const fill = card.querySelector('[data-field="fill"]');
  fill.setAttribute("width", (200 * joint.fill).toFixed(1));
  fill.classList.toggle("over", joint.is_impact);
  card.dataset.window = joint.window;
}

function troubles(found) {
  document.getElementById("troubles-section").hidden = !found.length;
  document.getElementById("troubles").replaceChildren(...found.map((one) => element("li", {},
    element("strong", {}, one.device), `: ${one.text}`,
    ...(one.place ? ["; look at the cable at ", element("code", {}, one.place)] : []))));
}

function sinks(found) {
  document.getElementById("sinks-section").hidden = !found.length;
  document.getElementById("sinks").replaceChildren(...found.map((one) => element("tr", {},
    element("th", { scope: "row" }, one.sink),
    element("td", {}, element("strong", { class: "state", "data-state": one.state }, one.state), ` ${one.since}`),
    element("td", {}, one.error || "–"))));
}

listen({
  cards(robot) {
    if (robot.joints.some((joint) => !cards.has(joint.joint))) { location.reload(); return; }
    document.getElementById("unwatched").hidden = robot.is_watched;
    robot.joints.forEach((joint) => show(cards.get(joint.joint), joint));
    document.getElementById("alarms-section").hidden = !robot.alarms.length;
    showAlarms(document.getElementById("alarms"), robot.alarms);
    troubles(robot.troubles);
    sinks(robot.sinks);
    document.body.dataset.updated = robot.time;
  },
});
actOnAlarms(document.getElementById("alarms"));
