// The page: what arrives goes to its panels, and what is looked at is asked for.

import { CameraPanel, LcdPanel } from "/static/camera.js";
import { Controls } from "/static/controls.js";
import { DepthPanel, ResidualPanel } from "/static/depth.js";
import { Guide } from "/static/guide.js";
import { History } from "/static/history.js";
import { Link } from "/static/link.js";
import * as lists from "/static/lists.js";
import { recolour } from "/static/plots.js";
import { SolidPanel } from "/static/solid.js";
import { lasting, showState, showFigures, stale } from "/static/state.js";
import { Timeline } from "/static/timeline.js";

const $ = (id) => document.getElementById(id);
const SLOW_MS = { residual: 250, lcd: 300, place: 3000, sigma: 500 };
const visible = (id) => !$(id).hidden && $(id).offsetParent !== null;

const camera = new CameraPanel(), lcd = new LcdPanel(), depth = new DepthPanel(), residual = new ResidualPanel();
const solid = new SolidPanel(), history = new History(), guide = new Guide();
const asked = {};
let lattice = null, arrived = 0, painted = 0;

const page = (window.zeromethod = { contents: 0, latencies_ms: [], values: {}, arrived: [] });

function due(part) {
  const now = performance.now();
  if (now - (asked[part] ?? -1e9) < SLOW_MS[part]) return false;
  asked[part] = now;
  return true;
}

// What is looked at, the slow ones now and then.
function wanted() {
  const next = ["camera"];
  if (visible("depth")) {
    next.push("surface");
    if (due("place")) next.push("place");
    if ((depth.kind === "sigma" || !$("section-plot").hidden) && due("sigma")) next.push("sigma");
  }
  if ((visible("residual-tab") || $("show-mask").checked) && due("residual")) next.push("residual");
  if (visible("lcd-tab") && due("lcd")) next.push("lcd");
  return document.hidden ? { next: [] } : { next, probe: depth.probe };
}

async function content(message) {
  arrived = performance.now();
  const { parts, values } = message;
  page.values = values;
  for (const part of [parts.residual, parts.surface]) if (part?.lattice) lattice = part.lattice;
  // the pictures first: what is seen is as new as can be
  const pictures = [parts.camera && camera.take(parts.camera), parts.lcd && lcd.take(parts.lcd)];
  if (parts.surface) camera.surface = parts.surface;
  if (parts.residual && lattice) {
    residual.take(parts.residual, lattice);
    camera.setMask(residual.map);
  }
  if (lattice) depth.take(parts, lattice);
  await Promise.all(pictures);
  camera.paint();
  if (parts.lcd) lcd.paint();
  await new Promise(requestAnimationFrame);
  seen(message);
  depth.takeProbe(message.probe);
  history.take(message.rows);
  said(message.said);
  paint(message);
  if (parts.surface && depth.place) solid.take(depth.surface, depth.place, depth.scales.depth);
}

// How long ago what is on the screen now was exposed.
function seen(message) {
  page.contents += 1;
  page.arrived.push(performance.now());
  if (message.unix_time_ms && message.parts.camera) {
    const late = performance.timeOrigin + performance.now() - message.unix_time_ms;
    page.latencies_ms.push(late);
    $("latency").textContent = late > -5 && late < 60000 ? `exposure to pixel ${late.toFixed(0)} ms` : "";
  }
  for (const list of [page.latencies_ms, page.arrived]) if (list.length > 2000) list.shift();
}

function said(list) {
  lists.events(list);
  for (const one of list) if (one.kind !== "state") history.mark(one.time_s);
}

function paint(message) {
  const { values } = message, now = performance.now();
  if (Object.keys(values).length) {
    showState(values);
    showFigures(values);
    controls.show(values);
    timeline.show(values);
    guide.show(values);
    lists.values(values, lasting(values));
    if (values.duration_s != null) history.moment(values.time_s);
    if (now - painted > 200) {
      painted = now;
      history.paint();
      lists.contacts(values.contacts ?? []);
      lists.calibration(values);
    }
  }
}

function hello(message) {
  const table = message.hello;
  document.body.dataset.mode = table.mode;
  document.title = `zeromethod ${table.mode}`;
  $("timeline").hidden = table.mode !== "replay";
  lists.beginValues(table);
  $("events").replaceChildren();
  controls.begin(table, message.may_control);
  timeline.begin(table, message.may_control);
  if (table.mode === "replay") $("history-span").value = "0";
  history.begin(message.columns, message.rows);
  said(message.said);
  page.table = table;
}

function linkState(state, why) {
  page.link = state;
  $("link-state").textContent = state === "open" ? "connected" : why || "no connection";
  if (state === "closed") {
    arrived = -1e9;
    stale(true, why || "no connection; trying again every second");
  }
}

const keys = {
  d: () => {
    const dark = document.documentElement.dataset.theme
      ? document.documentElement.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    document.documentElement.dataset.theme = localStorage.theme = dark ? "light" : "dark";
    repaint();
  },
  f: () => depth.holdScale(),
  c: () => depth.clear(),
};
["events-tab", "contacts-tab", "calibration-tab", "values-tab"].forEach((id, index) => {
  keys[index + 1] = () => document.querySelector(`[data-tab="${id}"]`).click();
});

function repaint() {
  recolour();
  camera.paint();
  lcd.paint();
  depth.paint();
  residual.paint();
  solid.paint(true);
}

if (localStorage.theme) document.documentElement.dataset.theme = localStorage.theme;
for (const tab of document.querySelectorAll("[data-tab]")) {
  tab.addEventListener("click", () => {
    for (const other of tab.closest("h2").querySelectorAll("[data-tab]")) {
      other.setAttribute("aria-pressed", other === tab);
      $(other.dataset.tab).hidden = other !== tab;
    }
    repaint();
  });
}
for (const id of ["show-mask", "show-contacts"]) $(id).addEventListener("change", () => camera.paint());
new ResizeObserver(repaint).observe($("camera"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);

const call = (method, args) => link.call(method, args);
const controls = new Controls(call, keys), timeline = new Timeline(call);
const link = new Link(wanted, { hello, content, state: linkState });
setInterval(() => {
  const silent = (performance.now() - arrived) / 1000;
  if (page.link === "open") stale(silent > 1.5, arrived > 0 ? `nothing new for ${silent.toFixed(0)} s` : "waiting for the run");
}, 250);
