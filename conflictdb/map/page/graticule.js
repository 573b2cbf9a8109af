// Meridians and parallels above the map, and what they are. On Web Mercator they are straight, to the pixel.

import { display } from "./display.js";
import { MERCATOR_END } from "./model.js";
import { colour, font } from "./theme.js";
import { mercatorX, mercatorY } from "./world.js";

const STEPS = [60, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001];
const MINUTES = [30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01]; // instead of decimals of degrees
const LEAST_PX = 110; // between two of them
const SCALE_PX = 164; // room of the scale, bottom left
const LABEL_PX = 14; // height of a label

const latitudeAt = (y) => (Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) * 180) / Math.PI;

// The finest step at which lines are apart enough, where a degree is so many pixels.
const steps = () => (display.isNautical ? [...STEPS.filter((step) => step >= 1), ...MINUTES.map((minutes) => minutes / 60)] : STEPS);
const stepOf = (degreePx) => steps().findLast((step) => step * degreePx >= LEAST_PX) ?? STEPS[0];

// All multiples of a step between two numbers.
function multiples(step, from, to) {
  const first = Math.ceil(from / step - 1e-9);
  return Array.from({ length: Math.max(0, Math.floor(to / step + 1e-9) - first + 1) }, (_, n) => (first + n) * step);
}

function named(value, step, positive, negative) {
  if (display.isNautical && step < 1) return inMinutes(value, step, positive, negative);
  const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  const size = Math.abs(value).toFixed(digits);
  return [0, 180].includes(Number(size)) ? `${Number(size)}°` : `${size}° ${value < 0 ? negative : positive}`;
}

function inMinutes(value, step, positive, negative) {
  const digits = Math.max(0, Math.ceil(-Math.log10(step * 60) - 1e-9));
  const units = Math.round(Math.abs(value) * 60 * 10 ** digits);
  const [degrees, rest] = [Math.floor(units / (60 * 10 ** digits)), units % (60 * 10 ** digits)];
  const minutes = (rest / 10 ** digits).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  return `${degrees}°${rest ? `${minutes}′` : ""}${units === 0 || (degrees === 180 && !rest) ? "" : ` ${value < 0 ? negative : positive}`}`;
}

// What is in a frame (map.js): meridians with x and parallels with y, pixels, each with its degrees and its name.
export function graticule({ size, width, height, left, top }) {
  const [west, east] = [(left - 0.5) * 360, (left + width / size - 0.5) * 360];
  const [south, north] = [latitudeAt(Math.min(1, top + height / size)), latitudeAt(Math.max(0, top))];
  const middle = latitudeAt(Math.min(1, Math.max(0, top + height / size / 2)));
  const across = stepOf(size / 360);
  const up = stepOf(size / 360 / Math.cos((middle * Math.PI) / 180));
  return {
    meridians: multiples(across, west, east).map((lon) => {
      const turned = lon - 360 * Math.ceil((lon - 180) / 360); // -180 < turned <= 180
      return { degrees: turned, x: (mercatorX(lon) - left) * size, name: named(turned, across, "E", "W") };
    }),
    parallels: multiples(up, Math.max(south, -MERCATOR_END), Math.min(north, MERCATOR_END)).map((lat) => (
      { degrees: lat, y: (mercatorY(lat) - top) * size, name: named(lat, up, "N", "S") })),
  };
}

export class Graticule {
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.drawn = "";
    view.map.on("render", () => this.draw());
  }

  redraw() {
    this.drawn = "";
    this.draw();
  }

  draw() {
    const frame = this.view.frame();
    const ratio = window.devicePixelRatio || 1;
    const wanted = JSON.stringify([frame, ratio, colour("line-map")]);
    if (wanted === this.drawn) return; // only time has moved
    this.drawn = wanted;
    const { width, height } = frame;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.shown = graticule(frame);
    context.fillStyle = colour("line-map");
    for (const { x } of this.shown.meridians) context.fillRect(Math.round(x), 0, 1, height);
    for (const { y } of this.shown.parallels) context.fillRect(0, Math.round(y), width, 1);
    context.font = font("small");
    context.textBaseline = "alphabetic";
    context.lineJoin = "round";
    for (const { x, name } of this.shown.meridians) {
      if (x > SCALE_PX && x + context.measureText(name).width + 8 < width) this.write(context, name, x + 4, height - 6);
    }
    for (const { y, name } of this.shown.parallels) if (y > LABEL_PX + 4 && y < height - 48) this.write(context, name, 6, y - 4);
  }

  write(context, text, x, y) {
    context.strokeStyle = colour("sea");
    context.lineWidth = 3;
    context.strokeText(text, x, y);
    context.fillStyle = colour("ink-soft");
    context.fillText(text, x, y);
  }
}
