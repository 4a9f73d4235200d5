"use strict";
// Draws each recorded column over the model's, the residual below it; both zoom and pan together.
(() => {
  const figures = JSON.parse(document.getElementById("data").textContent);
  const charts = [];
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const times = (s) => s.time ? Array.from(new Float64Array(bytes(s.time)))
    : Array.from({ length: s.count }, (_, i) => s.start + i * s.spacing);

  function unpack(signal) {
    const column = (name) => Array.from(new Float32Array(bytes(signal[name])));
    const time = times(signal), measured = column("measured");
    const models = ["modelled", "before"].filter((name) => signal[name]).map(column);
    const left = (model) => measured.map((v, i) => (v - model[i]) * signal.residual_factor);
    return { time, overlay: [time, measured, ...models], residual: [time, ...models.map(left)] };
  }

  const digits = (v) => v == null ? "–" : v.toPrecision(4).replace("-", "−");
  const axis = (label, size) => ({
    label, size, stroke: colour("text"), font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
    labelSize: 20, values: (_, splits) => splits.map((v) => String(+v.toPrecision(6)).replace("-", "−")), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("grid"), width: 1, size: 5 },
  });
  const line = (label, name, width = 1.3) => ({ label, stroke: colour(name), width, points: { show: false },
                                   value: (_, v) => digits(v) });

  function options(signal, width, height, time, series, label, extra) {
    return {
      width, height, series: [time, ...series],
      scales: { x: { time: false } },
      axes: [axis("time (s)", 28), axis(label, 54)],
      cursor: { drag: { x: true, y: false, setScale: true }, sync: { key: signal.id } },
      ...extra,
    };
  }

  // The band of ±2 sigma, within which 95 % of the noise lies.
  const floor = (noise) => (u) => {
    if (!noise) return;
    const { left, width, top, height } = u.bbox;
    const [a, b] = [u.valToPos(2 * noise, "y", true), u.valToPos(-2 * noise, "y", true)];
    const [from, to] = [Math.max(a, top), Math.min(b, top + height)];
    u.ctx.fillStyle = colour("band");
    u.ctx.fillRect(left, from, width, Math.max(to - from, 0));
  };

  class Chart {
    constructor(signal) {
      this.signal = signal;
      this.root = document.getElementById(signal.id);
      this.data = unpack(signal);
      this.whole = [this.data.time[0], this.data.time[this.data.time.length - 1]];
      this.range = this.whole;
      this.plots = [];
      this.build();
      this.root.querySelectorAll("button").forEach((b) => b.addEventListener("click", () => this.act(b.dataset.do)));
      this.root.addEventListener("keydown", (e) => this.key(e));
      new ResizeObserver(() => this.fit()).observe(this.root.querySelector(".chart"));
    }

    get width() { return Math.max(this.root.querySelector(".chart").clientWidth, 240); }

    build(width = this.width, scale = 1) {
      this.plots.forEach((p) => p.destroy());
      const { signal: s, data } = this;
      const tall = scale * (width < 500 ? 220 : 280), low = scale * 180;
      const follow = { setScale: [(u, key) => key === "x" && this.show(u.scales.x.min, u.scales.x.max)] };
      const [above, below] = this.root.querySelectorAll(".chart");
      const time = { label: "time (s)", value: (_, v) => digits(v) };
      const before = (show) => s.before ? [{ ...line("without what was found", "noise"), show }] : [];
      const overlay = options(s, width, tall, time,
                              [line("measured", "measured", 2.4), line("modelled", "modelled"), ...before(false)],
                              `${s.what} (${s.unit})`, { hooks: follow });
      const residual = options(s, width, low, {}, [line("measured − modelled", "residual"), ...before(true)],
                               `residual (${s.residual_unit})`,
                               { hooks: { ...follow, drawClear: [floor(s.noise * s.residual_factor)] } });
      this.plots = [new uPlot(overlay, data.overlay, above), new uPlot(residual, data.residual, below)];
      this.plots.forEach((p) => this.gestures(p));
      this.apply();
    }

    fit() {
      const width = this.width;
      this.plots.forEach((p) => p.width === width || p.setSize({ width, height: p.height }));
    }

    apply() {
      const [min, max] = this.range;
      this.applying = true;
      this.plots.forEach((p) => p.batch(() => p.setScale("x", { min, max })));
      this.applying = false;
    }

    // Both plots show the same stretch, kept within the recording and a few samples wide at least.
    show(min, max) {
      if (this.applying || min == null || max == null) return;
      const [first, last] = this.whole;
      const least = 4 * (last - first) / this.data.time.length;
      const width = Math.min(Math.max(max - min, least), last - first);
      const from = Math.min(Math.max((min + max - width) / 2, first), last - width);
      if (from === this.range[0] && from + width === this.range[1]) return;
      this.range = [from, from + width];
      this.apply();
    }

    zoom(factor, at = (this.range[0] + this.range[1]) / 2) {
      const [min, max] = this.range;
      this.show(at - (at - min) * factor, at + (max - at) * factor);
    }

    pan(share) {
      const [min, max] = this.range, by = share * (max - min);
      this.show(min + by, max + by);
    }

    act(what) {
      ({ in: () => this.zoom(0.5), out: () => this.zoom(2), left: () => this.pan(-0.25), right: () => this.pan(0.25),
         whole: () => this.show(...this.whole) })[what]();
    }

    key(event) {
      const what = { "+": "in", "=": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", 0: "whole" }[event.key];
      if (!what || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.act(what);
    }

    // Wheel with Ctrl (a pinch on a touchpad) zooms; one finger pans, two zoom; the mouse's drag is uPlot's own.
    gestures(plot) {
      const over = plot.over, fingers = new Map();
      over.addEventListener("wheel", (event) => {
        if (!event.ctrlKey && !event.shiftKey) return;
        event.preventDefault();
        const turn = event.deltaY || event.deltaX;
        this.zoom(turn > 0 ? 1.25 : 0.8, plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x"));
      }, { passive: false });
      over.addEventListener("pointerdown", (e) => e.pointerType === "touch" && fingers.set(e.pointerId, e.clientX));
      ["pointerup", "pointercancel"].forEach((name) => over.addEventListener(name, (e) => fingers.delete(e.pointerId)));
      over.addEventListener("pointermove", (event) => {
        if (!fingers.has(event.pointerId)) return;
        const before = [...fingers.values()];
        fingers.set(event.pointerId, event.clientX);
        const after = [...fingers.values()];
        const box = over.getBoundingClientRect();
        if (after.length === 1) this.pan((before[0] - after[0]) / box.width);
        if (after.length === 2) {
          const spread = Math.abs(after[1] - after[0]) || 1;
          this.zoom(Math.abs(before[1] - before[0]) / spread,
                    plot.posToVal((after[0] + after[1]) / 2 - box.left, "x"));
        }
      });
    }
  }

  const rebuild = (...size) => charts.forEach((c) => c.build(...size));
  const draw = (signal) => charts.push(new Chart(signal));
  const visible = new IntersectionObserver((entries) => entries.filter((e) => e.isIntersecting).forEach((e) => {
    visible.unobserve(e.target);
    draw(figures.find((f) => f.id === e.target.id));
  }), { rootMargin: "400px" });
  figures.forEach((f) => visible.observe(document.getElementById(f.id)));

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => rebuild());
  addEventListener("beforeprint", () => {
    figures.filter((f) => !charts.some((c) => c.signal === f)).forEach(draw);
    document.documentElement.classList.add("paper");
    rebuild(640, 0.75);  // two recordings on a sheet of A4
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("paper");
    rebuild();
  });
  window.lostmotion = { charts };
})();
