// Colour maps of even lightness, made in OKLab: they read the same in grey and to the colour-blind.

function fromOklch(lightness, chroma, hue) {
  const a = chroma * Math.cos((hue * Math.PI) / 180), b = chroma * Math.sin((hue * Math.PI) / 180);
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const linear = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  return linear.map((x) => {
    const v = Math.min(Math.max(x, 0), 1);
    return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
  });
}

function table(colour) {
  const bytes = new Uint8Array(3 * 256);
  for (let i = 0; i < 256; i++) bytes.set(colour(i / 255), 3 * i);
  return bytes;
}

// blue to yellow: depth
export const DEPTH = table((t) => fromOklch(0.27 + 0.65 * t, 0.075 + 0.02 * Math.sin(2 * Math.PI * t - 2), 265 - 165 * t));
// dark to light orange: what should be small
export const SMALL = table((t) => fromOklch(0.2 + 0.7 * t, 0.02 + 0.13 * Math.sin(Math.PI * Math.min(t * 1.1, 1)), 45 + 35 * t));

export const css = (map, t) => {
  const i = 3 * Math.round(255 * Math.min(Math.max(t, 0), 1));
  return `rgb(${map[i]},${map[i + 1]},${map[i + 2]})`;
};

// Colours of the page, as the style sheet has them now; asked for once after each change.
const inks = new Map();
export function ink(name) {
  if (!inks.has(name)) inks.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return inks.get(name);
}
export const dry = () => inks.clear();

// A step of 1, 2 or 5 times a power of ten, so that about `count` of them span a range.
export function niceStep(range, count) {
  const raw = range / count, power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((x) => x * power >= raw);
}

// A number with as many digits as a step of that size needs.
export const rounded = (value, step) => value.toFixed(Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9))));
