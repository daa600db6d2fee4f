// Calibration and focus: the step, what to do now, how far it is, what was found.

const $ = (id) => document.getElementById(id);

export class Guide {
  show(values) {
    if (!("instruction" in values)) return;
    const box = $("guide-body"), line = (kind, text) => {
      const p = document.createElement("p");
      p.className = kind;
      p.textContent = text;
      return p;
    };
    const parts = [line("step", values.step_name ?? ""), line("do", values.instruction ?? "")];
    if (values.progress != null) parts.push(Object.assign(document.createElement("progress"), { max: 1, value: values.progress }));
    if (values.verdict) parts.push(line("big", values.verdict));
    const list = document.createElement("ul");
    for (const words of values.lines ?? []) list.append(Object.assign(document.createElement("li"), { textContent: words }));
    parts.push(list);
    box.replaceChildren(...parts);
  }
}
