// Buttons for every method of the table, the form that asks for arguments, and the keys.

const $ = (id) => document.getElementById(id);
const TITLES = {
  pause: "Pause", resume: "Resume", zero: "Zero", gain: "Gain…", exposure: "Exposure…", target: "Target…",
  record: "Record…", stop_recording: "Stop recording", snapshot: "Snapshot", mark: "Mark…", stop: "Stop run",
  play: "Play", seek: "Go to…", speed: "Speed…", stretch: "Loop a stretch…", close: "Close",
};
// of two methods with one key the one that makes sense now
const PAIRS = {
  play: (v) => !v.playing, pause: (v) => v.playing ?? !v.paused, resume: (v) => v.paused, record: (v) => !v.recording, stop_recording: (v) => v.recording,
};
// methods that are worth a word though they need none
const ASKS = new Set(["record", "mark"]);
// methods that end something ask first
const SURE = { stop: "End the run? What was measured is kept." };
// present values, for the form
const PRESENT = { gain: "gain", exposure: "exposure_ms", target: "contrast", seek: "time_s", speed: "speed" };
const ON_TIMELINE = new Set(["play", "pause", "seek", "speed", "stretch"]);
const HERE = [
  ["?", "this list"], ["d", "dark or light"], ["f", "hold the colour scale"], ["c", "forget the clicked point"],
  ["1 to 4", "events, contacts, calibration, all values"], ["mouse", "depth: drag A and B, click a place; surface: drag, wheel"],
];

export class Controls {
  constructor(call, keys) {
    Object.assign(this, { call, keys, values: {}, methods: [] });
    document.addEventListener("keydown", (event) => this.key(event));
  }

  begin(table, mayControl) {
    this.methods = table.methods;
    this.mayControl = mayControl;
    this.replay = table.mode === "replay";
    const here = this.methods.filter((one) => !(this.replay && ON_TIMELINE.has(one.name)));
    $("controls").replaceChildren(...here.map((one) => this.button(one)));
    const help = this.small("?", "Keys", () => this.help());
    const theme = this.small("d", "Dark", () => this.keys.d());
    // what was answered has a place of its own: nothing moves when it comes
    this.said = Object.assign(document.createElement("span"), { id: "said" });
    this.said.setAttribute("role", "status");
    if (!mayControl) this.said.textContent = "this page may only view";
    $("controls").append(this.said, help, theme);
    this.show(this.values);
  }

  small(key, title, act) {
    const button = document.createElement("button");
    button.innerHTML = `${title} <kbd>${key}</kbd>`;
    button.addEventListener("click", act);
    return button;
  }

  button(method) {
    const button = document.createElement("button");
    button.dataset.method = method.name;
    button.title = method.doc;
    button.disabled = !this.mayControl;
    const title = TITLES[method.name] ?? method.name;
    button.innerHTML = method.key ? `${title} <kbd>${method.key}</kbd>` : title;
    button.addEventListener("click", () => this.start(method.name));
    return button;
  }

  show(values) {
    this.values = values;
    for (const button of document.querySelectorAll("[data-method]")) {
      const fits = PAIRS[button.dataset.method];
      if (fits) button.hidden = !fits(values);
    }
    const shown = (name) => document.querySelector(`[data-method="${name}"]`)?.classList;
    shown("resume")?.add("on");
    shown("stop_recording")?.add("on");
  }

  start(name) {
    const method = this.methods.find((one) => one.name === name);
    if (!method || !this.mayControl) return;
    const asks = ASKS.has(name) || SURE[name] || method.arguments.some((one) => one.required);
    if (asks) this.ask(method);
    else this.run(name, {});
  }

  async run(name, args) {
    try {
      this.done(name, await this.call(name, args));
    } catch (error) {
      this.report(error.message, true);
    }
  }

  done(name, result) {
    const files = result.files ?? (result.file ? [result.file] : []);
    this.report(`${name.replace("_", " ")}: done${files.length ? ` (${files.join(", ")})` : ""}`);
  }

  report(words, bad = false) {
    this.said.textContent = this.said.title = words;
    this.said.classList.toggle("bad", bad);
  }

  // A form for the arguments of a method.
  ask(method) {
    const dialog = $("ask"), form = document.createElement("form");
    form.method = "dialog";
    form.innerHTML = `<h3></h3><p></p><div class="fields"></div><div class="error" role="alert"></div>
      <menu><button value="no" type="button">Cancel</button><button value="yes" type="submit">OK</button></menu>`;
    form.querySelector("h3").textContent = TITLES[method.name]?.replace("…", "") ?? method.name;
    form.querySelector("p").textContent = SURE[method.name] ?? method.doc;
    const inputs = method.arguments.map((one) => {
      const label = document.createElement("label"), input = document.createElement("input");
      input.name = one.name;
      input.type = one.type === "text" ? "text" : "number";
      input.step = "any";
      input.required = one.required;
      if (one.least != null) input.min = one.least;
      if (one.most != null) input.max = one.most;
      const present = this.values[PRESENT[method.name]];
      if (one.type === "number" && typeof present === "number") input.value = Number(present.toPrecision(5));
      const range = one.least != null && one.most != null ? `, ${one.least} to ${one.most}` : "";
      label.textContent = `${one.name}${one.unit ? `, ${one.unit}` : ""} (${one.doc}${range})`;
      label.append(input);
      form.querySelector(".fields").append(label);
      return [one, input];
    });
    form.querySelector('[value="no"]').addEventListener("click", () => dialog.close());
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      const args = {};
      for (const [one, input] of inputs) {
        if (input.value !== "") args[one.name] = one.type === "text" ? input.value : Number(input.value);
      }
      try {
        this.done(method.name, await this.call(method.name, args));
        dialog.close();
      } catch (error) {
        form.querySelector(".error").textContent = error.message;
      }
    });
    dialog.replaceChildren(form);
    dialog.showModal();
    (inputs[0]?.[1] ?? form.querySelector('[value="yes"]')).focus();
  }

  help() {
    const rows = this.methods.filter((one) => one.key).map((one) => [one.key, one.doc]);
    const dialog = $("help");
    dialog.innerHTML = "<h3>Keys</h3><table></table><menu><button>Close</button></menu>";
    for (const [key, words] of [...rows, ...HERE]) {
      const row = dialog.querySelector("table").insertRow();
      row.insertCell().innerHTML = `<kbd>${key}</kbd>`;
      row.cells[0].style.whiteSpace = "nowrap";
      row.insertCell().textContent = words;
      row.cells[1].style.textAlign = "left";
    }
    dialog.querySelector("button").addEventListener("click", () => dialog.close());
    dialog.showModal();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || $("ask").open || event.target.matches("input[type=text], input[type=number], select")) return;
    if (event.key === "?") this.help();
    else if ($("help").open) return;
    else if (this.keys[event.key]) this.keys[event.key]();
    else {
      const fits = this.methods.filter((one) => one.key === event.key && (PAIRS[one.name]?.(this.values) ?? true));
      if (!fits.length) return;
      this.start(fits[0].name);
    }
    event.preventDefault();
  }
}
