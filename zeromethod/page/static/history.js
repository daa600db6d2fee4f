// The history of a run: peak with its sigma above, one other figure below; of what rubs, share in contact and speed.

import { plot } from "/static/plots.js";

const $ = (id) => document.getElementById(id);
const MOST = 20000;
const STICK = 0.1; // of the height of the plot of speed
const LABELS = {
  residual_px: "residual, px", loop_rate_hz: "loop, Hz", delay_ms: "delay, ms", dropped: "dropped",
  force_normal_n: "force, N",
};

export class History {
  constructor() {
    this.rows = [];
    this.columns = [];
    this.marks = [];
    const marks = () => (this.now == null ? this.marks : [...this.marks, this.now]);
    this.peak = plot($("history-peak"), "s", [
      { label: "peak, µm", stroke: "--accent", width: 1.5 },
      { label: "2 sigma below", stroke: "--soft", dash: [3, 3] },
      { label: "2 sigma above", stroke: "--soft", dash: [3, 3] },
    ], marks);
    this.other = plot($("history-other"), "s", [{ label: "residual, px", stroke: "--good", width: 1.5 }], marks);
    this.share = plot($("rubbing-share"), "s", [{ label: "in contact, %", stroke: "--accent", width: 1.5 }], marks);
    this.speed = plot($("rubbing-speed"), "s", [
      { label: "mm/s, shaded: slip", stroke: "--accent", width: 1.5 },
      { label: "slip", stroke: "--warn", band: true },
      { label: "stick", stroke: "--good", band: true },
    ], marks);
    for (const id of ["history-kind", "history-span"]) $(id).addEventListener("change", () => this.paint());
  }

  begin(columns, rows) {
    this.columns = columns;
    this.rows = rows;
    this.marks = [];
    const kinds = columns.filter((name) => LABELS[name]);
    $("history-kind").replaceChildren(...kinds.map((name) => new Option(LABELS[name].split(",")[0], name)));
    $("history-kind").value = "residual_px";
    this.paint();
  }

  take(rows) {
    if (!rows.length) return;
    // time that goes back: a recording was scrubbed
    if (this.rows.length && rows[0][0] < this.rows.at(-1)[0]) this.rows = this.rows.filter((row) => row[0] < rows[0][0]);
    this.rows.push(...rows);
    if (this.rows.length > MOST) this.rows.splice(0, this.rows.length - MOST);
  }

  // the moment of a recording that is shown
  moment(time) {
    this.now = time;
  }

  mark(time) {
    if (time != null) this.marks.push(time);
    if (this.marks.length > 200) this.marks.shift();
  }

  paint() {
    const at = (name) => this.columns.indexOf(name);
    const time = at("time_s"), span = Number($("history-span").value);
    if (time < 0 || !this.rows.length) return;
    const from = span ? this.rows.at(-1)[time] - span : -Infinity;
    let rows = this.rows.filter((row) => row[time] >= from);
    const stride = Math.ceil(rows.length / 2000);
    if (stride > 1) rows = rows.filter((_, index) => index % stride === 0);
    const peak = at("peak_mm"), sigma = at("peak_sigma_mm"), kind = $("history-kind").value;
    const times = rows.map((row) => row[time]);
    const um = (row, factor) => (row[peak] == null ? null : 1e3 * (row[peak] + factor * (row[sigma] ?? 0)));
    if (peak >= 0) this.peak.set([times, rows.map((r) => um(r, 0)), rows.map((r) => um(r, -2)), rows.map((r) => um(r, 2))]);
    this.other.name(LABELS[kind] ?? kind);
    this.other.set([times, rows.map((row) => row[at(kind)])]);
    const [share, speed, slips] = ["share", "speed_mm_s", "slips"].map((name) => rows.map((row) => row[at(`rubbing_${name}`)]));
    if (share.some((one) => one != null)) $("rubbing-button").hidden = false; // only a run with --rubbing has the tab
    this.share.set([times, share.map((one) => (one == null ? null : 100 * one))]);
    this.speed.set([times, speed, slips.map((one) => (one ? 1 : null)), slips.map((one) => (one === false ? STICK : null))]);
  }
}
