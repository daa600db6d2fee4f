// A map over the node lattice as a picture with a colour bar and contours, in the camera's view.

import { css, ink, niceStep, rounded } from "/static/colours.js";

// Size a canvas to its place on the screen; its scale in device pixels.
export function fit(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  return scale;
}

// Where a picture of (columns, rows) stands in a canvas: scale and the place of its corner.
export function placed(canvas, columns, rows) {
  const zoom = Math.min(canvas.width / columns, canvas.height / rows);
  return { zoom, left: (canvas.width - zoom * columns) / 2, top: (canvas.height - zoom * rows) / 2 };
}

// A drawing that is kept, and made again only when `key` changes: lines cost more than pictures.
export class Layer {
  constructor() {
    this.canvas = document.createElement("canvas");
  }
  onto(context, key, draw) {
    const { width, height } = context.canvas, whole = `${key} ${width} ${height}`;
    if (whole !== this.key) {
      this.key = whole;
      Object.assign(this.canvas, { width, height });
      draw(this.canvas.getContext("2d"));
    }
    context.drawImage(this.canvas, 0, 0);
  }
}

const CONTOURS_MS = 200;
export const MEASURED = 1; // of the kinds of node
const GREY = 128, HATCH = 5; // nodes from stripe to stripe

export class Scale {
  // Follows the range at once outwards, slowly inwards, so that colours do not jump. least: smallest range.
  constructor(least, fromZero = false) {
    Object.assign(this, { least, fromZero, low: NaN, high: NaN, held: false });
  }
  follow(values) {
    if (this.held && Number.isFinite(this.low)) return;
    let low = Infinity, high = -Infinity;
    for (const v of values) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
    if (low > high) return;
    if (this.fromZero) low = 0;
    if (high - low < this.least) {
      const middle = (high + low) / 2;
      low = this.fromZero ? 0 : middle - this.least / 2;
      high = low + this.least;
    }
    const ease = (now, wanted, outwards) => (Number.isFinite(now) && !outwards ? now + 0.05 * (wanted - now) : wanted);
    this.low = ease(this.low, low, low < this.low);
    this.high = ease(this.high, high, high > this.high);
  }
  share(value) {
    return (value - this.low) / (this.high - this.low);
  }
}

export class MapView {
  constructor(canvas, bar, colours, scale, unit) {
    Object.assign(this, { canvas, bar, colours, scale, unit, lattice: null, image: [640, 512] });
    this.raster = document.createElement("canvas");
    this.lines = new Layer();
  }

  // lattice: { shape, values, first: [u, v], spacing, image: [columns, rows] }, and where there are any, `kind`:
  // nodes that were not measured themselves are hatched; `key`: contours are drawn again when it changes
  show(lattice) {
    this.lattice = lattice;
    this.image = lattice.image;
    const [rows, columns] = lattice.shape;
    if (this.raster.width !== columns || this.raster.height !== rows) {
      Object.assign(this.raster, { width: columns, height: rows });
    }
    const pixels = new ImageData(columns, rows);
    const { low, high } = this.scale, factor = 255 / (high - low);
    for (let i = 0; i < lattice.values.length; i++) {
      const value = lattice.values[i];
      if (Number.isNaN(value)) continue;
      const at = 3 * Math.min(255, Math.max(0, Math.round((value - low) * factor)));
      const grey = lattice.kind && lattice.kind[i] !== MEASURED && ((i % columns) + Math.floor(i / columns)) % HATCH < 2;
      for (let c = 0; c < 3; c++) pixels.data[4 * i + c] = grey ? GREY : this.colours[at + c];
      pixels.data[4 * i + 3] = 255;
    }
    this.raster.getContext("2d").putImageData(pixels, 0, 0);
  }

  paint(withContours) {
    const scale = fit(this.canvas), context = this.canvas.getContext("2d");
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    const at = placed(this.canvas, ...this.image);
    this.at = at;
    context.fillStyle = ink("--grid");
    context.fillRect(at.left, at.top, at.zoom * this.image[0], at.zoom * this.image[1]);
    if (!this.lattice) return;
    const { shape, first, spacing } = this.lattice;
    context.save();
    context.beginPath();
    context.rect(at.left, at.top, at.zoom * this.image[0], at.zoom * this.image[1]);
    context.clip();
    const cell = at.zoom * spacing;
    context.drawImage(
      this.raster, at.left + at.zoom * first[0] - cell / 2, at.top + at.zoom * first[1] - cell / 2,
      cell * shape[1], cell * shape[0],
    );
    if (withContours) {
      this.lines.onto(context, this.lattice.key ?? Math.floor(performance.now() / CONTOURS_MS), (layer) => this.contours(layer, scale));
    }
    context.restore();
    this.paintBar(withContours);
  }

  levels() {
    const step = niceStep(this.scale.high - this.scale.low, 7), found = [];
    for (let k = Math.ceil(this.scale.low / step); k * step <= this.scale.high; k++) found.push(k * step || 0);
    return [found, step];
  }

  // Marching squares.
  contours(context, scale) {
    const { shape: [rows, columns], values } = this.lattice;
    const [levels] = this.levels();
    context.lineWidth = 0.8 * scale;
    context.strokeStyle = "#fffb";
    context.beginPath();
    for (let j = 0; j + 1 < rows; j++) {
      for (let i = 0; i + 1 < columns; i++) {
        const k = j * columns + i;
        const corner = [values[k], values[k + 1], values[k + columns + 1], values[k + columns]];
        const low = Math.min(...corner), high = Math.max(...corner);
        if (!(low < high)) continue;
        for (const level of levels) {
          // of a plane at rest that line would be noise alone
          if (level === 0 || level <= low || level >= high) continue;
          const cuts = [];
          for (let e = 0; e < 4; e++) {
            const a = corner[e] - level, b = corner[(e + 1) % 4] - level;
            if (a < 0 === b < 0) continue;
            const t = a / (a - b);
            cuts.push([i + [t, 1, 1 - t, 0][e], j + [0, t, 1, 1 - t][e]]);
          }
          for (let c = 0; c + 1 < cuts.length; c += 2) {
            context.moveTo(...this.onCanvas(cuts[c]));
            context.lineTo(...this.onCanvas(cuts[c + 1]));
          }
        }
      }
    }
    context.stroke();
  }

  onCanvas([column, row], { first, spacing } = this.lattice) {
    return [this.at.left + this.at.zoom * (first[0] + spacing * column), this.at.top + this.at.zoom * (first[1] + spacing * row)];
  }

  // (column, row) of a lattice, fractions allowed, of a place on the screen
  node(event, { first, spacing } = this.lattice) {
    const box = this.canvas.getBoundingClientRect(), scale = this.canvas.width / box.width;
    const u = ((event.clientX - box.left) * scale - this.at.left) / this.at.zoom;
    const v = ((event.clientY - box.top) * scale - this.at.top) / this.at.zoom;
    return [(u - first[0]) / spacing, (v - first[1]) / spacing];
  }

  paintBar() {
    const scale = fit(this.bar), context = this.bar.getContext("2d");
    const range = [this.scale.low, this.scale.high].map((value) => value.toPrecision(3));
    const { width, height } = this.bar, key = [...range, this.unit.name, ink("--ink"), width, height].join(" ");
    if (key === this.barred) return;
    this.barred = key;
    const top = 18 * scale, bottom = height - 6 * scale, bar = 12 * scale;
    context.clearRect(0, 0, width, height);
    for (let y = top; y < bottom; y++) {
      context.fillStyle = css(this.colours, (bottom - y) / (bottom - top));
      context.fillRect(0, y, bar, 1);
    }
    context.fillStyle = ink("--ink");
    context.font = `${11 * scale}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    context.fillText(this.unit.name, 0, 8 * scale);
    const [levels, step] = this.levels();
    for (const level of levels) {
      const y = bottom - this.scale.share(level) * (bottom - top);
      context.fillRect(bar, y, 4 * scale, scale);
      context.fillText(rounded(level * this.unit.factor, step * this.unit.factor), bar + 6 * scale, y);
    }
  }
}
