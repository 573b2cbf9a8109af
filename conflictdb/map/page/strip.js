// The strip of departures: what forbids each, in a lane for each object, and all together above.

import { printable } from "./format.js";
import { colour, font, theme } from "./theme.js";
import { union } from "./what_if.js";

const PAD = 10; // half of the slider's thumb, pixels: both have one scale
const LANE = 18;
const TOP = 14; // of all together
const AXIS = 18;
const MOST_LANES = 5; // the last one is of all others, where there are more
const LEAST_BAR = 2;
const STEPS_S = [60, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200];
const TICK_PX = 56;

// "+15 min", of seconds.
function tick(s) {
  if (s === 0) return "0";
  const sign = s < 0 ? "−" : "+";
  const by = Math.abs(s);
  return by % 3600 === 0 ? `${sign}${by / 3600} h` : `${sign}${by / 60} min`;
}

export class DepartureStrip {
  // `onMove(us)` hears of a pointer.
  constructor(canvas, onMove) {
    Object.assign(this, { canvas, lanes: [], all: [], range: 1, at: 0 });
    const move = ({ offsetX }) => {
      const share = Math.min(1, Math.max(0, (offsetX - PAD) / this.width()));
      onMove(Math.round((2 * share - 1) * this.range));
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); move(event); });
    canvas.addEventListener("pointermove", (event) => { if (canvas.hasPointerCapture(event.pointerId)) move(event); });
    new ResizeObserver(() => this.draw()).observe(canvas);
    theme.onChange(() => this.draw());
  }

  // Forbidden departures by key, [low, high] each, microseconds, within a range.
  take(forbidden, range) {
    this.range = range;
    this.all = union([...forbidden.values()].flat());
    const lasts = (spans) => spans.reduce((sum, [low, high]) => sum + high - low, 0);
    const sorted = [...forbidden].sort((a, b) => lasts(b[1]) - lasts(a[1]));
    const own = sorted.length > MOST_LANES ? sorted.slice(0, MOST_LANES - 1) : sorted;
    const rest = sorted.slice(own.length);
    this.lanes = own.map(([key, spans]) => ({ label: printable(key), spans }));
    if (rest.length) this.lanes.push({ label: `${rest.length} others`, spans: union(rest.flatMap(([, spans]) => spans)) });
    this.canvas.style.height = `${TOP + this.lanes.length * LANE + AXIS}px`;
    this.draw();
  }

  mark(at) {
    this.at = at;
    this.draw();
  }

  width() {
    return Math.max(1, this.canvas.clientWidth - 2 * PAD);
  }

  x(us) {
    return PAD + ((us + this.range) / (2 * this.range)) * this.width();
  }

  draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const bar = ([low, high], y, tall) => context.fillRect(this.x(low), y, Math.max(LEAST_BAR, this.x(high) - this.x(low)), tall);
    // All that is not forbidden is clear.
    context.fillStyle = colour("clear");
    context.fillRect(PAD, 2, this.width(), TOP - 6);
    context.fillStyle = colour("conflict");
    for (const span of this.all) bar(span, 2, TOP - 6);
    context.font = font("small");
    context.textBaseline = "middle";
    this.lanes.forEach(({ label, spans }, n) => {
      const y = TOP + n * LANE;
      context.globalAlpha = 0.35;
      context.fillStyle = colour("conflict");
      for (const span of spans) bar(span, y + 2, LANE - 4);
      context.globalAlpha = 1;
      context.fillStyle = colour("ink");
      context.textAlign = "left";
      context.fillText(label, PAD + 4, y + LANE / 2, width / 2);
    });
    this.drawAxis(context, height);
    context.fillStyle = colour("ink");
    context.fillRect(Math.round(this.x(this.at)) - 1, 0, 2, height - AXIS + 4);
  }

  drawAxis(context, height) {
    const rangeS = this.range / 1e6;
    const wanted = (2 * rangeS * TICK_PX) / this.width();
    const step = STEPS_S.find((one) => one >= wanted) ?? STEPS_S[STEPS_S.length - 1];
    context.textAlign = "center";
    for (let s = -Math.floor(rangeS / step) * step; s <= rangeS; s += step) {
      const x = this.x(1e6 * s);
      context.fillStyle = colour("line");
      context.fillRect(Math.round(x), TOP - 4, 1, height - AXIS - TOP + 6);
      context.fillStyle = colour("ink-soft");
      const half = context.measureText(tick(s)).width / 2;
      context.fillText(tick(s), Math.min(this.canvas.clientWidth - half, Math.max(half, x)), height - 7);
    }
  }
}
