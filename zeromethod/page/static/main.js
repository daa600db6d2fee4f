// The page: what arrives goes to its panels, and what is looked at is asked for.

import { CameraPanel, PicturePanel } from "/static/camera.js";
import { Controls } from "/static/controls.js";
import { DepthPanel, ResidualPanel } from "/static/depth.js";
import { Guide } from "/static/guide.js";
import { History } from "/static/history.js";
import { Link } from "/static/link.js";
import * as lists from "/static/lists.js";
import { recolour } from "/static/plots.js";
import { SolidPanel } from "/static/solid.js";
import { lasting, showState, showFigures, showFine, stale } from "/static/state.js";
import { Timeline } from "/static/timeline.js";

const $ = (id) => document.getElementById(id);
const WORDS_MS = 200;
const SLOW_MS = { residual: 250, lcd: 300, projected: 100, place: 3000, sigma: 500 };
const visible = (id) => !$(id).hidden && $(id).offsetParent !== null;

const lcd = new PicturePanel("lcd-canvas"), projector = new PicturePanel("projector-canvas");
const camera = new CameraPanel(), depth = new DepthPanel(), residual = new ResidualPanel();
const solid = new SolidPanel(), history = new History(), guide = new Guide();
const asked = {};
let lattice = null, arrived = 0, painted = 0, stated = "", waiting = null;

const page = (window.zeromethod = { contents: 0, stages: [], values: {}, arrived: [] });

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
    next.push(...depth.wants(page.values.fine_time_s));
    if (((depth.kind === "sigma" && !depth.fine) || !$("section-plot").hidden) && due("sigma")) next.push("sigma");
  }
  if ((visible("residual-tab") || $("show-mask").checked) && due("residual")) next.push("residual");
  if (visible("lcd-tab") && due("lcd")) next.push("lcd");
  if ((visible("projector-tab") || $("projector-button").hidden) && due("projected")) next.push("projected");
  return document.hidden ? { next: [] } : { next, probe: depth.probe };
}

const unix = () => performance.timeOrigin + performance.now();

// The browser's next picture; it makes none of a page that is hidden.
const frame = () => new Promise((go) => (document.hidden ? setTimeout(go, 500) : requestAnimationFrame(go)));

// After the picture that is being made has been handed over to the screen.
const channel = new MessageChannel();
const handing = [];
channel.port1.onmessage = () => handing.shift()();
const shown = () => new Promise((go) => {
  handing.push(go);
  channel.port2.postMessage(null);
});

// The camera's picture first, so that what is seen is as new as can be; then, while the next one is on its way, all else.
async function content(message, ask) {
  arrived = performance.now();
  const { parts, values } = message;
  page.values = values;
  if (Object.keys(values).length) controls.values = values; // of two methods with one key, the one that makes sense now
  for (const part of [parts.residual, parts.surface]) if (part?.lattice) lattice = part.lattice;
  if (parts.camera) await camera.take(parts.camera);
  message.decoded = unix();
  if (parts.surface) camera.surface = parts.surface;
  await frame();
  if (parts.camera) camera.paint();
  await shown();
  seen(message);
  ask();
  stale(false);
  if (parts.residual && lattice) {
    residual.take(parts.residual, lattice);
    camera.setMask(residual.map);
  }
  if (lattice) depth.take(parts, lattice, values.state !== "resting");
  depth.takeProbe(message.probe);
  history.take(message.rows);
  said(message.said);
  if (Object.keys(values).length) paint(values);
  if (parts.surface && depth.place) solid.take(depth.surface, depth.place, depth.scales.depth);
  if (parts.lcd) lcd.take(parts.lcd).then(() => lcd.paint());
  if (parts.projected) {
    $("projector-button").hidden = false; // only a rig that has a projector has the tab
    projector.pointers = values.pointers ?? [];
    projector.take(parts.projected).then(() => projector.paint());
  }
}

// How long ago what is on the screen now was exposed.
function seen(message) {
  page.contents += 1;
  page.first_ms ??= performance.now();
  solid.begin();
  page.arrived.push(performance.now());
  if (message.stages_ms && message.parts.camera) {
    page.stages.push({ ...message.stages_ms, arrived: message.arrived, decoded: message.decoded, painted: unix() });
  }
  for (const list of [page.stages, page.arrived]) if (list.length > 2000) list.shift();
}

function said(list) {
  lists.events(list);
  for (const one of list) if (one.kind !== "state") history.mark(one.time_s);
}

// Words and plots five times a second, which is as often as they can be read; a new state at once.
function paint(values) {
  const now = performance.now(), steady = lasting(values);
  if (values.duration_s != null) history.moment(values.time_s);
  timeline.show(values);
  if (now - painted < WORDS_MS && steady.state === stated) {
    waiting = values;
    return;
  }
  [painted, stated, waiting] = [now, steady.state, null];
  showState(steady, camera.time);
  showFigures(values);
  showFine(values, depth.fine, depth.pixels[depth.kind]?.time_s);
  showLatency(values);
  controls.show(values);
  guide.show(values);
  lists.values(values, steady);
  history.paint();
  lists.contacts(values.contacts ?? []);
  lists.calibration(values);
}

// Median of the last second, by the clocks of both machines.
function showLatency(values) {
  const late = page.stages.slice(-20).map((one) => one.painted - one.exposed).sort((a, b) => a - b);
  const middle = late[Math.floor(late.length / 2)];
  const known = middle > -5 && middle < 60000 ? `exposure to pixel ${middle.toFixed(0)} ms` : "";
  const kind = values.duration_s != null ? "recorded, not live" : values.simulated_time ? "in simulated time" : known;
  if ($("latency").textContent !== kind) $("latency").textContent = kind;
}

function hello(message) {
  const table = message.hello;
  document.body.dataset.mode = table.mode;
  document.title = `zeromethod ${table.mode}`;
  $("timeline").hidden = table.mode !== "replay";
  lists.beginValues(table);
  $("events").replaceChildren();
  controls.begin(table, message.may_control);
  guide.begin(table);
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
  projector.paint();
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
  if (waiting) paint(waiting);
  const silent = (performance.now() - arrived) / 1000;
  if (page.link === "open") stale(silent > 1.5, arrived > 0 ? `nothing new for ${silent.toFixed(0)} s` : "waiting for the run");
}, 250);
