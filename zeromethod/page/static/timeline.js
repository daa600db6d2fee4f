// The time line of a recording: play, scrub, speed, a stretch played over and over.

const $ = (id) => document.getElementById(id);

export class Timeline {
  constructor(call) {
    this.call = call;
    this.dragging = false;
  }

  begin(table, mayControl) {
    if (table.mode !== "replay") return;
    $("timeline").innerHTML = `<button data-method="play">▶ Play <kbd>p</kbd></button>
      <button data-method="pause">❚❚ Pause <kbd>p</kbd></button>
      <input type="range" id="scrub" data-method="seek" min="0" max="1" step="0.001" aria-label="time of the recording">
      <output id="scrub-at"></output>
      <select id="speed" data-method="speed" aria-label="speed"></select>
      <button id="loop-from" title="play from here …">loop from here</button><button id="loop-to" title="… to here, over and over">to here</button>
      <button id="loop-none" data-method="stretch">whole</button><output id="loop-shown"></output>`;
    $("speed").append(...[0.1, 0.25, 0.5, 1, 2, 5, 10].map((x) => new Option(`× ${x}`, x)));
    for (const one of $("timeline").querySelectorAll("button, input, select")) one.disabled = !mayControl;
    $("timeline").querySelector('[data-method="play"]').onclick = () => this.call("play");
    $("timeline").querySelector('[data-method="pause"]').onclick = () => this.call("pause");
    $("scrub").oninput = () => {
      this.dragging = true;
      this.call("seek", { time_s: Number($("scrub").value) });
    };
    $("scrub").onchange = () => {
      this.dragging = false;
    };
    $("speed").onchange = () => this.call("speed", { value: Number($("speed").value) });
    $("loop-from").onclick = () => this.stretch(Number($("scrub").value), this.values.to_s);
    $("loop-to").onclick = () => this.stretch(this.values.from_s, Number($("scrub").value));
    $("loop-none").onclick = () => this.stretch(0, this.values.duration_s);
  }

  stretch(from, to) {
    this.call("stretch", { from_s: from, to_s: Math.max(to, from) }).catch(() => {});
  }

  show(values) {
    if ($("timeline").hidden || !("duration_s" in values)) return;
    this.values = values;
    $("scrub").max = values.duration_s;
    if (!this.dragging) $("scrub").value = values.time_s;
    $("scrub-at").textContent = `${values.time_s.toFixed(2)} of ${values.duration_s.toFixed(2)} s`;
    if (document.activeElement !== $("speed")) $("speed").value = values.speed;
    $("loop-shown").textContent = values.from_s > 0 || values.to_s < values.duration_s ? `${values.from_s.toFixed(2)} to ${values.to_s.toFixed(2)} s` : "";
    $("timeline").querySelector('[data-method="play"]').hidden = values.playing;
    $("timeline").querySelector('[data-method="pause"]').hidden = !values.playing;
  }
}
