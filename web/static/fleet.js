// The fleet's page: asks for all robots again and again while somebody looks.
import { ask, element, say } from "./common.js";

const EVERY_MS = 5000;
const part = (id) => document.getElementById(id);
let shown = "";

const health = (value) => element("span", { class: "health", "data-health": value }, value);

function joint(one) {
  const words = `score ${one.score} (level ${one.level}), severity ${one.severity}; last window ${one.last}`;
  return element("li", { "data-joint": one.joint },
    element("p", { class: "member" }, element("strong", {}, one.joint), " ", health(one.health)),
    element("p", { class: "why" }, words),
    ...one.alarms.map((text) => element("p", { class: "warn" }, text)));
}

function robot(one) {
  return element("li", { class: "card", "data-robot": one.robot, "data-health": one.health },
    element("h3", {}, one.robot, " ", health(one.health)),
    element("ul", { class: "plain" }, ...one.joints.map(joint)),
    ...(one.joints.length ? [] : [element("p", { class: "why" }, "no joint yet")]));
}

function show(found) {
  if (JSON.stringify(found) === shown) return;
  shown = JSON.stringify(found);
  part("missing-section").hidden = !found.missing.length;
  part("missing").replaceChildren(...found.missing.map(([name, why]) =>
    element("li", { class: "warn missing" }, element("strong", {}, name), `: ${why}`)));
  part("robots-section").hidden = !found.robots.length;
  part("robots").replaceChildren(...found.robots.map(robot));
  const bad = found.robots.filter((one) => one.health !== "OK").length;
  part("fleet-words").textContent = `${found.robots.length} robots answer, ${bad} of them not OK` +
    (found.missing.length ? `; ${found.missing.length} missing.` : ".");
}

async function look() {
  if (!document.hidden) {
    try { show(await ask("/api/fleet")); say(""); }
    catch (error) { say(error instanceof TypeError ? "The connection to this page's server is lost; it is tried again." : error.message); }
  }
  setTimeout(look, EVERY_MS);
}

look();
