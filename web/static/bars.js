// Bars that fall from one value to another.

const SVG = "http://www.w3.org/2000/svg";
function drawn(tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

// A bar that falls from one share of its width to another; noise: where the floor is, as a share.
export function bar(from, to, noise, kind = "") {
  const svg = drawn("svg", { viewBox: "0 0 100 10", preserveAspectRatio: "none", class: `fall ${kind}`, "aria-hidden": "true" });
  const width = (share) => String(Math.max(0, Math.min(100 * share, 100)));
  const fill = drawn("rect", { class: "fill", x: 0, y: 1, width: width(from), height: 8 });
  svg.append(drawn("rect", { class: "was", x: 0, y: 1, width: width(from), height: 8 }), fill);
  if (noise != null) svg.append(drawn("line", { x1: width(noise), x2: width(noise), y1: 0, y2: 10 }));
  requestAnimationFrame(() => requestAnimationFrame(() => fill.setAttribute("width", width(to))));
  return svg;
}

const LOGARITHMIC = 30; // times the noise, from which on a bar of it would not be seen

// What share of a bar a value is; on a logarithmic scale where the largest is far above the noise.
export function scale(values, noise) {
  const most = Math.max(...values.filter(isFinite)) || 1;
  if (!(noise > 0) || most < LOGARITHMIC * noise) return { share: (v) => v / most, note: "" };
  const least = noise / 3;
  return { share: (v) => Math.log(Math.max(v, least) / least) / Math.log(most / least), note: " The bars are logarithmic." };
}
