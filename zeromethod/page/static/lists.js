// Events with their times, contacts, the calibration, and every value there is.

const $ = (id) => document.getElementById(id);
const MOST = 200;
const BAD = /fault|lost|refused|stalled|moved|full|dropped/i;
const CONTACT = [
  ["id", "contact", 0], ["x_mm", "x, mm", 2], ["y_mm", "y, mm", 2], ["area_mm2", "area, mm²", 2], ["major_mm", "long, mm", 2],
  ["minor_mm", "short, mm", 2], ["angle_deg", "angle, °", 0], ["depth_mm", "depth, µm", 2], ["force_n", "force, N", 4],
];

export function events(said) {
  for (const { kind, words, time_s: time } of said) {
    if (kind === "call" && words.startsWith("seek")) continue; // as often as the mouse moves
    const item = document.createElement("li");
    item.className = BAD.test(words) ? "bad" : kind;
    item.append(Object.assign(document.createElement("time"), { textContent: time == null ? "" : `${time.toFixed(2)} s` }));
    const said = words.replace(/\{"note": "(.*)"\}/, "“$1”");
    item.append(`${kind === "call" ? "▸ " : kind === "state" ? "◆ " : words.startsWith("!") ? "" : "! "}${said}`);
    $("events").prepend(item);
  }
  while ($("events").children.length > MOST) $("events").lastChild.remove();
}

export function contacts(list) {
  $("contact-count").textContent = list.length ? `(${list.length})` : "";
  const table = document.createElement("table");
  if (!list.length) {
    $("contacts-tab").textContent = "Nothing touches.";
    return;
  }
  const head = table.createTHead().insertRow();
  for (const [, title] of CONTACT) head.append(Object.assign(document.createElement("th"), { textContent: title }));
  const body = table.createTBody();
  for (const one of list) {
    const row = body.insertRow();
    for (const [name, , digits] of CONTACT) {
      const value = name === "depth_mm" && one[name] != null ? 1e3 * one[name] : one[name];
      row.insertCell().textContent = value == null ? "–" : value.toFixed(digits);
    }
  }
  $("contacts-tab").replaceChildren(table);
}

export function calibration(values) {
  const box = $("calibration-tab"), known = values.calibrated;
  const sigma = values.calibration_sigma_percent;
  const lines = [
    [`big${known ? "" : " bad"}`, known ? "Calibrated" : "NOT CALIBRATED: depth is relative"],
    ["", values.calibration ?? ""],
    ["", sigma == null ? "" : `leaves open ${sigma.toFixed(2)} % of a press`],
  ];
  box.replaceChildren(...lines.map(([kind, words]) => Object.assign(document.createElement("p"), { className: kind, textContent: words })));
}

export function words(value, unit) {
  if (value == null) return "–";
  if (Array.isArray(value)) return `${value.length}`;
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return value;
  const text = Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6)));
  return unit ? `${text} ${unit}` : text;
}

export function beginValues(table) {
  $("values").replaceChildren();
  for (const one of table.values) {
    const row = $("values").insertRow();
    row.insertCell().textContent = one.name;
    row.insertCell().dataset.value = one.name;
    row.title = one.doc;
    row.cells[1].dataset.unit = one.unit;
  }
}

// steady: the same, without what only flashes, for the large letters
export function values(all, steady) {
  for (const cell of document.querySelectorAll("[data-value]")) {
    const text = words((cell.closest("table") ? all : steady)[cell.dataset.value], cell.dataset.unit);
    const shown = cell.closest("table") || text !== "–" ? text : "";
    if (cell.textContent !== shown) cell.textContent = shown;
  }
}
