// Calibration and focus: the step, what to do now, how far it is, what was found.

const $ = (id) => document.getElementById(id);

export class Guide {
  // figures: the numbers of the table, which are shown with what to do
  begin(table) {
    this.figures = table.values.filter((one) => one.type === "number" && one.name !== "progress");
  }

  shown(values) {
    const list = Object.assign(document.createElement("dl"), { className: "figures" });
    for (const { name, doc, unit } of this.figures) {
      if (values[name] == null) continue;
      const share = unit === "" && name.endsWith("share"), value = share ? 100 * values[name] : values[name];
      const row = document.createElement("div");
      row.append(Object.assign(document.createElement("dt"), { textContent: doc }));
      row.append(Object.assign(document.createElement("dd"), { textContent: `${Number(value.toPrecision(3))} ${share ? "%" : unit}` }));
      list.append(row);
    }
    return list;
  }

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
    const list = document.createElement("ul"), said = (values.lines ?? []).filter((words) => words !== values.instruction);
    for (const words of said) list.append(Object.assign(document.createElement("li"), { textContent: words }));
    if (this.figures.length) parts.push(this.shown(values));
    parts.push(list);
    box.replaceChildren(...parts);
  }
}
