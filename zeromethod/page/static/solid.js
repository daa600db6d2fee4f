// The surface in space, to turn: drag turns it, the wheel comes nearer.

import { DEPTH, ink } from "/static/colours.js";
import { MEASURED } from "/static/mapview.js";

const $ = (id) => document.getElementById(id);
const LINEAR = Float32Array.from({ length: 256 }, (_, k) => (k / 255) ** 2.2);
const EVERY = 2; // nodes left out between those that are drawn
const SHORTEST_MS = 90, WITHOUT_CARD_MS = 500; // between two pictures; one drawn by software holds up all others
const REST = 6; // so many times as long as a picture took passes before the next

// Whether there is no graphics card.
function bySoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl?.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
}

export class SolidPanel {
  constructor() {
    this.canvas = $("solid-canvas");
    this.turn = { azimuth: -0.6, height: 0.75, distance: 1.55 };
    this.painted = 0;
    this.listen();
  }

  // Loads what draws in space; three quarters of the page, so not before the first picture is there.
  begin() {
    if (this.begun) return;
    this.begun = true;
    import("/vendor/three.module.min.js").then((three) => this.make(three)).catch(() => {
      $("solid-note").textContent = "this browser has no WebGL";
    });
  }

  make(three) {
    this.three = three;
    const software = bySoftware();
    this.shortest = software ? WITHOUT_CARD_MS : SHORTEST_MS;
    this.renderer = new three.WebGLRenderer({ canvas: this.canvas, antialias: !software, alpha: true });
    this.scene = new three.Scene();
    this.camera = new three.PerspectiveCamera(35, 1, 0.01, 100);
    this.scene.add(new three.HemisphereLight(0xffffff, 0x667788, 2.2));
    const light = new three.DirectionalLight(0xffffff, 1.6);
    light.position.set(1, 1.5, 2);
    this.scene.add(light);
    this.geometry = new three.BufferGeometry();
    const material = new three.MeshStandardMaterial({ vertexColors: true, side: three.DoubleSide, roughness: 0.75, flatShading: false });
    this.mesh = new three.Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.frame = new three.LineSegments(new three.BufferGeometry(), new three.LineBasicMaterial({ color: 0x8899aa }));
    this.frame.frustumCulled = false;
    this.scene.add(this.mesh, this.frame);
    this.paint(true);
  }

  listen() {
    this.canvas.addEventListener("pointerdown", (event) => this.canvas.setPointerCapture(event.pointerId));
    this.canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.turn.azimuth -= 0.008 * event.movementX;
      this.turn.height = Math.min(1.5, Math.max(-1.5, this.turn.height + 0.008 * event.movementY));
      this.paint(true);
    });
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.turn.distance = Math.min(6, Math.max(0.8, this.turn.distance * 1.001 ** event.deltaY));
      this.paint(true);
    }, { passive: false });
    $("exaggeration").addEventListener("input", () => {
      this.chosen = true;
      this.paint(true);
    });
  }

  get factor() {
    const value = 10 ** Number($("exaggeration").value), power = 10 ** Math.floor(Math.log10(value));
    return Math.max(1, power * [1, 2, 5, 10].reduce((a, b) => (Math.abs(b - value / power) < Math.abs(a - value / power) ? b : a)));
  }

  take(surface, place, scale) {
    Object.assign(this, { surface, place, scale });
    this.paint(false);
  }

  // Vertices in units of the view's width; depth goes down.
  build() {
    const { shape: [rows, columns], values } = this.surface, { x, y } = this.place;
    const three = this.three, nx = Math.ceil(columns / EVERY), ny = Math.ceil(rows / EVERY), count = nx * ny;
    if (this.count !== count) {
      this.count = count;
      for (const name of ["position", "color", "normal"]) {
        this.geometry.setAttribute(name, new three.BufferAttribute(new Float32Array(3 * count), 3));
      }
    }
    let left = Infinity, right = -Infinity, low = Infinity, high = -Infinity;
    for (let k = 0; k < values.length; k++) {
      if (Number.isNaN(values[k])) continue;
      left = Math.min(left, x[k]); right = Math.max(right, x[k]);
      low = Math.min(low, y[k]); high = Math.max(high, y[k]);
    }
    if (left >= right) return;
    const size = Math.max(right - left, high - low), mx = (left + right) / 2, my = (low + high) / 2;
    if (!this.chosen && this.scale.high > this.scale.low) {
      // the depth shown as an eighth of the width, until somebody chooses
      const wanted = Math.log10(Math.max(1, (0.12 * size) / (1e-3 * (this.scale.high - this.scale.low))));
      if (Math.abs(wanted - Number($("exaggeration").value)) > 0.25) $("exaggeration").value = wanted;
    }
    const position = this.geometry.attributes.position.array, colour = this.geometry.attributes.color.array;
    const known = new Uint8Array(count), toMm = (1e-3 * this.factor) / size;
    for (let j = 0, n = 0; j < ny; j++) {
      for (let i = 0; i < nx; i++, n++) {
        const k = j * EVERY * columns + i * EVERY, depth = values[k];
        known[n] = !Number.isNaN(depth);
        position[3 * n] = (x[k] - mx) / size;
        position[3 * n + 1] = (y[k] - my) / size;
        position[3 * n + 2] = known[n] ? -depth * toMm : 0;
        const at = 3 * Math.round(255 * Math.min(1, Math.max(0, this.scale.share(depth) || 0)));
        const measured = this.surface.kind[k] === MEASURED; // what was not measured itself is grey
        for (let c = 0; c < 3; c++) colour[3 * n + c] = measured ? LINEAR[DEPTH[at + c]] : LINEAR[128];
      }
    }
    const index = [];
    for (let j = 0; j + 1 < ny; j++) {
      for (let i = 0; i + 1 < nx; i++) {
        const a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
        if (known[a] && known[b] && known[c] && known[d]) index.push(a, b, c, b, d, c);
      }
    }
    this.geometry.setIndex(index);
    this.geometry.attributes.position.needsUpdate = this.geometry.attributes.color.needsUpdate = true;
    this.geometry.computeVertexNormals();
    const [w, h] = [(right - left) / size / 2, (high - low) / size / 2];
    const corners = [[-w, -h, 0], [w, -h, 0], [w, -h, 0], [w, h, 0], [w, h, 0], [-w, h, 0], [-w, h, 0], [-w, -h, 0]];
    this.frame.geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(corners.flat()), 3));
    $("solid-note").textContent = `${(right - left).toFixed(0)} × ${(high - low).toFixed(0)} mm`;
  }

  paint(now) {
    if (!this.three || !this.surface || !this.place || document.hidden) return;
    const began = performance.now();
    if (!now && began - this.painted < Math.max(this.shortest, REST * (this.took ?? 0))) return;
    this.build();
    $("exaggeration-out").textContent = `depth × ${this.factor}`;
    const scale = Math.min(window.devicePixelRatio || 1, 2), { clientWidth: width, clientHeight: height } = this.canvas;
    if (width < 20 || height < 20) return;
    this.renderer.setPixelRatio(scale);
    this.renderer.setSize(width, height, false);
    const { azimuth, height: up, distance } = this.turn;
    this.camera.aspect = width / height;
    this.camera.position.set(
      distance * Math.cos(up) * Math.sin(azimuth), -distance * Math.cos(up) * Math.cos(azimuth), distance * Math.sin(up),
    );
    this.camera.up.set(0, 0, 1);
    this.camera.lookAt(0, 0, 0);
    this.camera.updateProjectionMatrix();
    this.frame.material.color.set(ink("--soft"));
    this.renderer.render(this.scene, this.camera);
    this.painted = performance.now();
    this.took = this.painted - began;
  }
}
