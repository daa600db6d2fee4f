// Plots over time and place, by uPlot, that follow their box and the colours of the page.

import { dry, ink, rounded } from "/static/colours.js";

const all = [];

class Plot {
  constructor(box, unit, series, marks) {
    Object.assign(this, { box, unit, series, marks, data: [[], ...series.map(() => [])] });
    all.push(this);
    new ResizeObserver(() => this.size()).observe(box);
    this.make();
  }

  make() {
    this.uplot?.destroy();
    const axis = (size, more) => ({
      stroke: ink("--soft"), grid: { stroke: ink("--grid"), width: 1 }, ticks: { stroke: ink("--grid"), width: 1 },
      font: "11px system-ui", size, gap: 3, ...more,
    });
    const place = { values: (_, all, __, ___, step) => all.map((value) => `${rounded(value, step)} ${this.unit}`) };
    const label = { label: this.series[0].label, labelSize: 14, labelFont: "11px system-ui", labelGap: 0 };
    this.uplot = new window.uPlot(
      {
        width: Math.max(this.box.clientWidth, 50), height: Math.max(this.box.clientHeight, 50), padding: [8, 10, 0, 0],
        scales: { x: { time: false }, band: { range: [0, 1] } }, legend: { show: false }, cursor: { drag: { x: false, y: false } },
        axes: [axis(22, place), axis(46, label)],
        series: [{}, ...this.series.map((one) => ({
          label: one.label, stroke: ink(one.stroke), width: one.width ?? 1, dash: one.dash, points: { show: false },
          // a shade over the share of the height that its values say, 0 to 1
          ...(one.band && { scale: "band", width: 0, fill: `${ink(one.stroke)}55`, paths: window.uPlot.paths.stepped({ align: -1 }) }),
        }))],
        hooks: { draw: [(u) => this.drawMarks(u)] },
      },
      this.data, this.box,
    );
  }

  drawMarks(u) {
    if (!this.marks) return;
    const context = u.ctx;
    context.save();
    context.strokeStyle = ink("--warn");
    context.setLineDash([2, 3]);
    for (const at of this.marks()) {
      const x = Math.round(u.valToPos(at, "x", true));
      if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
      context.beginPath();
      context.moveTo(x, u.bbox.top);
      context.lineTo(x, u.bbox.top + u.bbox.height);
      context.stroke();
    }
    context.restore();
  }

  set(data) {
    this.data = data;
    if (this.box.clientHeight > 20) this.uplot.setData(data);
  }

  name(label) {
    if (this.series[0].label === label) return;
    this.series[0].label = label;
    this.make();
  }

  size() {
    if (this.box.clientHeight > 20) {
      this.uplot.setSize({ width: this.box.clientWidth, height: this.box.clientHeight });
      this.uplot.setData(this.data);
    }
  }
}

export const plot = (box, unit, series, marks) => new Plot(box, unit, series, marks);
export function recolour() {
  dry();
  all.forEach((one) => one.make());
}
