// The state in large letters, the figures beside it, and marks on what is not of now.

const $ = (id) => document.getElementById(id);

// shape and word say it, colour too
const LOOKS = {
  locked: ["●", "good"], resting: ["○", "good"], nulling: ["◐", "warn"], starting: ["◌", ""], holding: ["‖", "warn"],
  passive: ["◎", "good"], approach: ["◉", "good"], paused: ["‖", "warn"], "not calibrated": ["△", "warn"], "bench moved": ["▲", "bad"], covered: ["◼", "warn"],
  lost: ["✕", "bad"], fault: ["✖", "bad"], stopped: ["■", ""], done: ["✔", "good"], failed: ["✖", "bad"],
};

const FLASH_S = 0.3, OLD_S = 0.5;
let since = null, steady = null, fineDoubt = "";

// A single frame that may not be used comes now and then: what lasts less than 0.3 s is not shown.
function lasting(values) {
  if (values.state !== "holding" || !steady || values.time_s < since) {
    since = values.time_s;
    if (values.state !== "holding") steady = values;
    return values;
  }
  return values.time_s - since < FLASH_S ? { ...values, state: steady.state, reason: steady.reason, fresh: true } : values;
}

// pictureS: time of the camera's picture, null where it is not known
export function showState(values, pictureS) {
  const [symbol, level] = LOOKS[values.state] ?? ["●", ""], doubt = values.doubt ?? "";
  $("symbol").textContent = symbol;
  // nothing looks good while depth does not count
  document.body.dataset.level = doubt && level === "good" ? "warn" : level;
  $("uncalibrated").hidden = values.calibrated !== false;
  // what does not count loses its colour; pictures that are not of now, too
  const old = pictureS != null && values.time_s - pictureS > OLD_S;
  document.body.classList.toggle("held", old);
  document.body.classList.toggle("doubted", doubt !== "" && values.state !== "paused");
  for (const badge of document.querySelectorAll(".badge")) {
    const ofDepth = doubt || (values.calibrated === false ? "relative: not calibrated" : "");
    const words = badge.closest("#camera") ? (old ? `picture of ${pictureS.toFixed(1)} s` : "") : ofDepth;
    label(badge, words);
  }
}

function label(badge, words) {
  badge.hidden = words === "";
  badge.textContent = words;
}

// Of the map on every pixel. looked: it is looked at. pictureS: its time, null where none has come yet
export function showFine(values, looked, pictureS) {
  $("every-pixel").hidden = values.fine_time_s == null;
  const fine = looked && values.fine_time_s != null, panel = $("depth");
  // what is still on the screen is no better than what it was when it came
  const newest = pictureS === values.fine_time_s || values.fine_doubt !== "";
  if (fine && newest) fineDoubt = values.fine_doubt;
  panel.classList.toggle("doubted", fine && fineDoubt !== "" && values.state !== "paused");
  if (!fine) {
    set("depth-note", values.peak_where ? `peak ${values.peak_where}` : "");
    return;
  }
  label(panel.querySelector(".badge"), fineDoubt || (values.calibrated === false ? "relative: not calibrated" : ""));
  const peak = values.fine_peak_mm == null ? "" : `peak ${um(values.fine_peak_mm, values.fine_peak_sigma_mm)}, `;
  const ago = `read ${(values.time_s - pictureS).toFixed(1)} s ago`;
  set("depth-note", pictureS == null ? "every pixel: none of this moment yet" : `every pixel: ${peak}${ago}`);
}

const set = (id, text) => {
  if ($(id).textContent !== text) $(id).textContent = text;
};
const digits = (value, sigma) => (sigma > 0 ? Math.max(0, Math.min(3, -Math.floor(Math.log10(sigma)))) : 2);
const um = (mm, sigma) => `${(1e3 * mm).toFixed(3)}${sigma == null ? "" : ` ± ${(1e3 * sigma).toFixed(3)}`} µm`;
const fixed = (value, n) => (value == null ? "–" : value.toFixed(n));

export function showFigures(values) {
  const um = values.peak_mm == null ? null : 1e3 * values.peak_mm;
  const sigma = values.peak_sigma_mm == null ? null : 1e3 * values.peak_sigma_mm;
  const n = digits(um, sigma);
  set("peak", fixed(um, n));
  set("peak-sigma", sigma == null ? "" : `± ${sigma.toFixed(n)}`);
  set("peak-name", values.calibrated === false ? "peak depth, relative" : "peak depth");
  set("peak-at", values.peak_x_mm == null ? "–" : `${values.peak_x_mm.toFixed(1)}, ${values.peak_y_mm.toFixed(1)}`);
  set("depth-sigma", fixed(values.depth_sigma_um, 3));
  set("force", fixed(values.force_normal_n, 3));
  const apart = values.force_normal_sigma_n;
  set("force-unit", values.force_normal_n == null ? "not known" : apart == null ? "N" : `± ${apart.toFixed(4)} N`);
  set("residual-rms", fixed(values.residual_px, 3));
  set("rate", fixed(values.loop_rate_hz, 1));
  set("delay", fixed(values.delay_ms, 1));
  // what comes is the state itself; what fails is said beside it
  set("watch", values.approach?.startsWith("watch camera") ? `△ ${values.approach}` : "");
  set("dropped", values.dropped == null ? "–" : String(values.dropped));
}

export { lasting };

export function stale(is, words) {
  document.body.classList.toggle("stale", is);
  $("banner").hidden = !is;
  $("banner").textContent = is ? `Not live: ${words}` : "";
}
