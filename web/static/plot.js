// Plots: what all of them share.  uPlot is a global (a script without modules).

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
export const number = (v) => v == null || !isFinite(v) ? "–" : Number(v.toPrecision(4)).toString().replace("-", "−");

const font = "12px system-ui, sans-serif";
const ticks = (_, values) => values.map((v) => v == null ? "" : Number(v.toPrecision(6)).toString().replace("-", "−"));

export const axis = (label, more = {}) => ({
  label, stroke: colour("text"), font, labelFont: font, labelSize: 18, size: label ? 46 : 30,
  grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("grid"), width: 1, size: 5 }, values: ticks, ...more,
});
export const timeAxis = () => ({ stroke: colour("text"), font, grid: { stroke: colour("grid"), width: 1 },
  ticks: { stroke: colour("grid"), width: 1, size: 5 }, space: 70 });
export const line = (label, name, more = {}) => ({ label, stroke: colour(name), width: 1.3, points: { show: false },
  value: (_, v) => number(v), ...more });

// A chart that fills its element and follows its width.
export function chart(root, options, data, height = 260) {
  root.replaceChildren();
  const plot = new uPlot({ width: root.clientWidth, height, ...options }, data, root);
  root.observer?.disconnect();
  root.observer = new ResizeObserver(() => plot.setSize({ width: root.clientWidth, height }));
  root.observer.observe(root);
  root.plot = plot;
  return plot;
}

// Draws behind the curves, between two values of x.
export function shade(plot, from, to, name) {
  const { top, height, left, width } = plot.bbox;
  const a = Math.max(plot.valToPos(from, "x", true), left), b = Math.min(plot.valToPos(to, "x", true), left + width);
  if (b <= a) return;
  plot.ctx.fillStyle = colour(name);
  plot.ctx.fillRect(a, top, b - a, height);
}

export function upright(plot, at, name, dash = []) {
  const { top, height, left, width } = plot.bbox, x = Math.round(plot.valToPos(at, "x", true));
  if (x < left || x > left + width) return;
  stroke(plot, name, dash, (ctx) => { ctx.moveTo(x, top); ctx.lineTo(x, top + height); });
}

export function stroke(plot, name, dash, draw) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.strokeStyle = colour(name);
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.setLineDash(dash.map((d) => d * devicePixelRatio));
  ctx.beginPath();
  draw(ctx);
  ctx.stroke();
  ctx.restore();
}

// All plots again when dark becomes light.
export function onTheme(draw) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}
