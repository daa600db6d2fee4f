// The camera's picture with what is laid over it, and the LCD's picture.

import { ink } from "/static/colours.js";
import { fit, Layer, placed } from "/static/mapview.js";

const $ = (id) => document.getElementById(id);

async function bitmap(part) {
  return createImageBitmap(new Blob([part.bytes], { type: "image/jpeg" }));
}

export class CameraPanel {
  constructor() {
    this.canvas = $("camera-canvas");
    this.picture = null;
    this.mask = null;
    this.surface = null;
    this.crosses = new Layer();
    this.masks = 0;
  }

  // The residual's lattice: what is not a number in it was not measured.
  setMask(mask) {
    this.mask = mask;
    this.masks += 1;
  }

  async take(part) {
    const picture = await bitmap(part);
    this.picture?.close();
    this.picture = picture;
    this.size = part.size;
    this.time = part.time_s;
    $("camera-note").textContent = `${part.size[0]} × ${part.size[1]} px`;
  }

  paint() {
    const scale = fit(this.canvas), context = this.canvas.getContext("2d");
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.picture) return;
    const at = placed(this.canvas, ...this.size);
    context.drawImage(this.picture, at.left, at.top, at.zoom * this.size[0], at.zoom * this.size[1]);
    if ($("show-mask").checked && this.mask) {
      this.crosses.onto(context, this.masks, (layer) => this.paintMask(layer, at, scale));
    }
    if ($("show-contacts").checked && this.surface) this.paintContacts(context, at, scale);
  }

  // small crosses where nothing is measured: shape, not colour alone
  paintMask(context, at, scale) {
    const { shape: [rows, columns], values, first, spacing } = this.mask, arm = 1.6 * scale;
    context.beginPath();
    for (let j = 0; j < rows; j++) {
      for (let i = 0; i < columns; i++) {
        const u = first[0] + spacing * i, v = first[1] + spacing * j;
        if (!Number.isNaN(values[j * columns + i]) || u < 0 || v < 0 || u >= this.size[0] || v >= this.size[1]) continue;
        const x = at.left + at.zoom * u, y = at.top + at.zoom * v;
        context.moveTo(x - arm, y - arm);
        context.lineTo(x + arm, y + arm);
        context.moveTo(x - arm, y + arm);
        context.lineTo(x + arm, y - arm);
      }
    }
    context.strokeStyle = "#ff6ad5";
    context.lineWidth = 0.8 * scale;
    context.stroke();
  }

  paintContacts(context, at, scale) {
    context.lineWidth = 2 * scale;
    context.font = `${13 * scale}px system-ui, sans-serif`;
    for (const { id, px } of this.surface.outlines ?? []) {
      context.beginPath();
      for (const [u, v] of px) context.lineTo(at.left + at.zoom * u, at.top + at.zoom * v);
      context.closePath();
      context.strokeStyle = "#000";
      context.setLineDash([]);
      context.stroke();
      context.strokeStyle = "#ffd84d";
      context.setLineDash([6 * scale, 4 * scale]);
      context.stroke();
      context.setLineDash([]);
      const [x, y] = [at.left + at.zoom * px[0][0] + 6 * scale, at.top + at.zoom * px[0][1]];
      context.fillStyle = "#000c";
      context.fillRect(x - 3 * scale, y - 12 * scale, context.measureText(`contact ${id}`).width + 6 * scale, 16 * scale);
      context.fillStyle = "#ffd84d";
      context.fillText(`contact ${id}`, x, y);
    }
  }
}

// The LCD's picture, or the projector's, with the fingers that are down in it.
export class PicturePanel {
  constructor(name) {
    this.canvas = $(name);
    this.picture = null;
    this.pointers = [];
  }
  async take(part) {
    const picture = await bitmap(part);
    this.picture?.close();
    this.picture = picture;
    this.size = part.size;
  }
  paint() {
    fit(this.canvas);
    const context = this.canvas.getContext("2d");
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.picture) {
      context.fillStyle = ink("--soft");
      context.fillText("no picture yet", 10, 20);
      return;
    }
    const at = placed(this.canvas, ...this.size);
    context.imageSmoothingQuality = "high";
    context.drawImage(this.picture, at.left, at.top, at.zoom * this.size[0], at.zoom * this.size[1]);
    const last = new Map(this.pointers.map((event) => [event.pointerId, event]));
    context.strokeStyle = context.fillStyle = "#ff6ad5";
    context.lineWidth = 2 * devicePixelRatio;
    for (const { type, pointerId, x, y, width, height, pressure } of last.values()) {
      if (type === "pointerup" || type === "pointercancel") continue;
      const [u, v] = [at.left + at.zoom * x, at.top + at.zoom * y];
      context.beginPath();
      context.ellipse(u, v, (at.zoom * width) / 2, (at.zoom * height) / 2, 0, 0, 2 * Math.PI);
      context.stroke();
      context.fillText(`${pointerId}: ${pressure.toFixed(2)}`, u + (at.zoom * width) / 2 + 4, v);
    }
  }
}
