// The depth map with its section line, the point that was clicked, and the plots of both.

import { DEPTH, SMALL, ink } from "/static/colours.js";
import { MapView, MEASURED, Scale } from "/static/mapview.js";
import { plot } from "/static/plots.js";

const $ = (id) => document.getElementById(id);
const GRIP_PX = 12;
const SAMPLES = 160;
const POINT = {
  depth: ["depth_um", "depth, µm"], sigma: ["sigma_um", "sigma, µm"],
  "slope x": ["slope_x_mrad", "slope x, mrad"], "slope y": ["slope_y_mrad", "slope y, mrad"],
};

export class DepthPanel {
  constructor() {
    this.scales = {
      depth: new Scale(2), sigma: new Scale(0.02, true), fine_depth: new Scale(0.2), fine_sigma: new Scale(0.002, true),
    };
    this.view = new MapView($("depth-canvas"), $("depth-bar"), DEPTH, this.scales.depth, { name: "mm", factor: 1e-3 });
    this.surface = this.sigma = this.place = null;
    this.pixels = { depth: null, sigma: null }; // the same on every pixel, each as of its `time_s`
    this.line = null; // two nodes, [column, row] each
    this.placed = false;
    this.probe = null;
    this.history = [];
    this.section = plot($("section-plot"), "mm", [
      { label: "depth, µm", stroke: "--accent", width: 1.5 },
      { label: "2 sigma below", stroke: "--soft", dash: [3, 3] },
      { label: "2 sigma above", stroke: "--soft", dash: [3, 3] },
      { label: "not measured itself", stroke: "--warn", width: 1.5, dash: [2, 4] },
    ]);
    this.point = plot($("point-history"), "s", [
      { label: "depth, µm", stroke: "--accent", width: 1.5 },
      { label: "2 sigma below", stroke: "--soft", dash: [3, 3] },
      { label: "2 sigma above", stroke: "--soft", dash: [3, 3] },
    ]);
    this.listen();
  }

  get kind() {
    return $("map-kind").value;
  }

  get fine() {
    return $("every-pixel").getAttribute("aria-pressed") === "true" && !$("every-pixel").hidden;
  }

  // Part to ask for: a newer map on every pixel, where it is looked at. newest_s: time of the newest there is.
  wants(newest_s) {
    return this.fine && this.pixels[this.kind]?.time_s !== newest_s ? [this.kind === "sigma" ? "fine_sigma" : "fine"] : [];
  }

  listen() {
    const canvas = this.view.canvas;
    let grip = -1, moved = false;
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.surface) return;
      canvas.setPointerCapture(event.pointerId);
      grip = this.gripAt(event);
      moved = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons || !this.surface || !this.line) return;
      moved = true;
      if (grip >= 0) {
        this.line[grip] = this.view.node(event, this.surface);
        this.placed = true;
      }
      this.paint();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (this.surface && grip < 0 && !moved) this.choose(this.view.node(event, this.surface).map(Math.round));
      grip = -1;
    });
    $("point-kind").addEventListener("change", () => this.paintPoint());
    $("contours").addEventListener("change", () => this.show());
    $("map-kind").addEventListener("change", () => this.choosePixels(this.fine));
    $("every-pixel").addEventListener("click", () => this.choosePixels(!this.fine));
    $("hold-scale").addEventListener("click", () => this.holdScale());
  }

  holdScale() {
    const held = !this.scales.depth.held;
    for (const scale of Object.values(this.scales)) scale.held = held;
    $("hold-scale").setAttribute("aria-pressed", held);
  }

  // What was not looked at meanwhile is not of now: it is asked for again.
  choosePixels(on) {
    $("every-pixel").setAttribute("aria-pressed", on);
    this.pixels = { depth: null, sigma: null };
    this.show();
    this.paint();
  }

  choose(node) {
    this.probe = node;
    this.history = [];
    document.querySelector('[data-tab="point-plot"]').click();
    this.paint();
  }

  clear() {
    this.probe = null;
    this.history = [];
    $("point").textContent = "";
    this.paint();
  }

  gripAt(event) {
    const box = this.view.canvas.getBoundingClientRect(), scale = this.view.canvas.width / box.width;
    return (this.line ?? []).findIndex((end) => {
      const [x, y] = this.view.onCanvas(end, this.surface);
      return Math.hypot(x / scale - (event.clientX - box.left), y / scale - (event.clientY - box.top)) < GRIP_PX;
    });
  }

  // pressed: there is a peak to follow
  take(parts, lattice, pressed) {
    if (parts.surface) this.surface = { ...parts.surface, values: parts.surface.maps.depth.values, ...lattice };
    if (parts.sigma) {
      this.sigma = { ...parts.sigma, values: parts.sigma.maps.sigma.values, kind: this.surface?.kind, ...lattice };
    }
    if (parts.place) this.place = { x: parts.place.maps.x.values, y: parts.place.maps.y.values };
    if (this.surface && !this.placed && (pressed || !this.line)) {
      // through the peak, until somebody drags it
      const [rows, columns] = this.surface.shape;
      const row = (this.surface.peak_node ?? [0, rows / 2])[1];
      this.line = [[0.08 * columns, row], [0.92 * columns, row]];
    }
    for (const [kind, part] of [["depth", parts.fine], ["sigma", parts.fine_sigma]]) {
      if (part) this.pixels[kind] = { ...part, values: part.maps[kind].values, key: `${kind} ${part.time_s}`, ...part.lattice };
    }
    const carried = !this.fine && this.surface?.kind.some((kind) => kind === 2 || kind === 3);
    $("kinds-note").textContent = carried ? "hatched: not measured there" : "";
    if (this.fine ? parts.fine || parts.fine_sigma : parts.surface) this.show();
    else if (parts.surface) this.paint();
  }

  show() {
    const map = this.fine ? this.pixels[this.kind] : this.kind === "sigma" ? this.sigma : this.surface;
    if (!map) {
      if (this.fine) this.view.lattice = null; // the nodes must not pass for it
      return;
    }
    const scale = this.scales[this.fine ? `fine_${this.kind}` : this.kind];
    scale.follow(map.values);
    this.view.scale = scale;
    this.view.colours = this.kind === "sigma" ? SMALL : DEPTH;
    this.view.unit = this.kind === "sigma" ? { name: "µm", factor: 1 } : { name: "mm", factor: 1e-3 };
    this.view.show(map);
    this.paint();
  }

  paint() {
    this.view.paint($("contours").checked);
    if (!this.surface || !this.view.at) return;
    const nodes = this.surface, peak = this.fine ? this.pixels[this.kind] : nodes;
    const context = this.view.canvas.getContext("2d"), scale = this.view.canvas.width / this.view.canvas.clientWidth;
    if (this.line) {
      const [a, b] = this.line.map((end) => this.view.onCanvas(end, nodes));
      for (const [colour, width] of [["#000", 3.5], ["#fff", 1.5]]) {
        context.strokeStyle = colour;
        context.lineWidth = width * scale;
        context.beginPath();
        context.moveTo(...a);
        context.lineTo(...b);
        context.stroke();
      }
      for (const [name, [x, y]] of [["A", a], ["B", b]]) {
        context.fillStyle = "#fff";
        context.beginPath();
        context.arc(x, y, 7 * scale, 0, 7);
        context.fill();
        context.fillStyle = "#000";
        context.font = `bold ${10 * scale}px system-ui, sans-serif`;
        context.textAlign = "center";
        context.textBaseline = "middle";
        context.fillText(name, x, y);
      }
      context.textAlign = "left";
    }
    if (peak?.peak_node) this.mark(context, this.view.onCanvas(peak.peak_node, peak), "peak", scale);
    if (this.probe) this.mark(context, this.view.onCanvas(this.probe, nodes), "point", scale);
    const now = performance.now();
    if (now - (this.sectioned ?? 0) > 200 || this.placed !== this.sectionedAt) {
      this.sectioned = now;
      this.sectionedAt = this.placed;
      this.paintSection();
    }
  }

  mark(context, [x, y], words, scale) {
    const arm = 6 * scale;
    context.strokeStyle = "#fff";
    context.lineWidth = 2 * scale;
    context.strokeRect(x - arm / 2, y - arm / 2, arm, arm);
    context.fillStyle = "#fff";
    context.font = `${11 * scale}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    context.fillText(words, x + arm, y - arm);
  }

  // Depth along the line, by the four nodes around each place on it.
  paintSection() {
    if (!this.place || !this.line || $("section-plot").hidden) return;
    const [a, b] = this.line, along = [], depth = [], below = [], above = [], carried = [];
    let last = null, way = 0;
    for (let s = 0; s <= SAMPLES; s++) {
      const node = [a[0] + ((b[0] - a[0]) * s) / SAMPLES, a[1] + ((b[1] - a[1]) * s) / SAMPLES];
      const x = this.at(this.place.x, node), y = this.at(this.place.y, node), value = this.at(this.surface.values, node);
      if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
      if (last) way += Math.hypot(x - last[0], y - last[1]);
      last = [x, y];
      const spread = this.sigma ? 2 * this.at(this.sigma.values, node) : NaN;
      const known = (v) => (Number.isFinite(v) ? v : null);
      along.push(way);
      const measured = this.surface.kind[Math.round(node[1]) * this.surface.shape[1] + Math.round(node[0])] === MEASURED;
      depth.push(measured ? known(value) : null);
      // joined to the last one that was measured
      carried.push(measured && depth.length > 1 && depth.at(-2) !== null ? null : known(value));
      below.push(known(value - spread));
      above.push(known(value + spread));
    }
    this.section.set([along, depth, below, above, carried]);
    if (last) $("section-note").textContent = `A to B: ${way.toFixed(1)} mm`;
  }

  at(values, [column, row]) {
    const [rows, columns] = this.surface.shape, i = Math.floor(column), j = Math.floor(row);
    if (i < 0 || j < 0 || i + 1 >= columns || j + 1 >= rows) return NaN;
    const s = column - i, t = row - j, k = j * columns + i;
    return (1 - t) * ((1 - s) * values[k] + s * values[k + 1]) + t * ((1 - s) * values[k + columns] + s * values[k + columns + 1]);
  }

  takeProbe(probe) {
    if (!probe || !this.probe) return;
    const words = (value, digits, unit) => (value == null ? "not known" : `${value.toFixed(digits)} ${unit}`);
    const rows = [
      ["depth", words(probe.depth_um, 2, "µm")], ["sigma", words(probe.sigma_um, 3, "µm")],
      ["slope x", words(probe.slope_x_mrad, 3, "mrad")], ["slope y", words(probe.slope_y_mrad, 3, "mrad")],
      ["at", `${words(probe.x_mm, 2, "")}, ${words(probe.y_mm, 2, "mm")}`], ["node is", probe.kind],
    ];
    $("point").replaceChildren(...rows.map(([name, value]) => {
      const box = document.createElement("div");
      box.append(Object.assign(document.createElement("dt"), { textContent: name }));
      box.append(Object.assign(document.createElement("dd"), { textContent: value }));
      return box;
    }));
    const last = this.history.at(-1)?.time_s;
    if (last === probe.time_s) return;
    if (last > probe.time_s) this.history = [];
    this.history.push(probe);
    if (this.history.length > 3000) this.history.shift();
    const now = performance.now();
    if (now - (this.pointed ?? 0) > 200) this.paintPoint();
  }

  paintPoint() {
    this.pointed = performance.now();
    if ($("point-plot").hidden) return;
    const [name, label] = POINT[$("point-kind").value], all = this.history;
    const band = (sign) => all.map((one) => (name !== "depth_um" || one.depth_um == null ? null : one.depth_um + sign * 2 * (one.sigma_um ?? 0)));
    this.point.name(label);
    this.point.set([all.map((one) => one.time_s), all.map((one) => one[name]), band(-1), band(1)]);
  }
}

export class ResidualPanel {
  constructor() {
    this.view = new MapView($("residual-canvas"), $("residual-bar"), SMALL, new Scale(0.1, true), { name: "px", factor: 1 });
  }
  take(part, lattice) {
    this.map = { ...part, values: part.maps.length.values, ...lattice };
    this.view.scale.follow(this.map.values);
    this.view.show(this.map);
    this.paint();
  }
  paint() {
    const hidden = $("residual-tab").hidden;
    $("small-note").textContent = this.map?.seams && !hidden ? "empty stripes: seams between teeth" : "";
    if (this.map && !hidden) this.view.paint(false);
    else if (!this.map) ink("--soft");
  }
}
