// Conflicts as bars over time, and the slider below them.

import { clock, day, moment } from "./format.js";
import { colour, theme } from "./theme.js";

const PAD = 10; // half of the slider's thumb, pixels: bars and slider have one scale
const AXIS = 18; // height of the axis
const LANE = 10; // height of a lane of bars and the gap below it; with many lanes less
const LEAST_LANE = 3;
const LEAST_BAR = 3; // width of a bar
const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800,
  1209600, 2592000, 7776000, 31536000, 63072000, 157680000];

export class Timeline {
  // `onTime(t)` hears of the slider, `onChoose(conflict)` of a bar that is clicked.
  constructor({ canvas, slider }, onTime, onChoose) {
    this.canvas = canvas;
    this.slider = slider;
    this.span = [0, 1];
    this.bars = [];
    this.t = 0;
    this.chosen = null;
    slider.addEventListener("input", () => onTime(Number(slider.value)));
    slider.addEventListener("keydown", (event) => {
      const [from, to] = this.span;
      const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };
      const wanted = event.key === "Home" ? from : event.key === "End" ? to
        : event.key in steps ? this.t + steps[event.key] * this.step() : null;
      if (wanted !== null) {
        event.preventDefault();
        onTime(wanted);
      }
    });
    let isDragged = false;
    canvas.addEventListener("pointerdown", (event) => {
      const bar = this.barAt(event);
      if (bar) {
        onChoose(bar);
        return;
      }
      isDragged = true;
      canvas.setPointerCapture(event.pointerId);
      onTime(this.timeAt(event.offsetX));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (isDragged) onTime(this.timeAt(event.offsetX));
      else canvas.classList.toggle("on-bar", this.barAt(event) !== null);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { isDragged = false; });
    new ResizeObserver(() => this.lay()).observe(canvas);
    theme.onChange(() => this.draw());
  }

  // A step of the keyboard: about a two hundredth of all.
  step() {
    const wanted = (this.span[1] - this.span[0]) / 200;
    return STEPS.find((step) => step >= wanted) ?? wanted;
  }

  take(conflicts, span) {
    this.span = span;
    this.conflicts = conflicts;
    [this.slider.min, this.slider.max] = span;
    this.lay();
  }

  x(t) {
    const [from, to] = this.span;
    const width = this.canvas.clientWidth - 2 * PAD;
    return PAD + Math.min(1, Math.max(0, (t - from) / (to - from))) * width;
  }

  timeAt(x) {
    const [from, to] = this.span;
    const share = (x - PAD) / (this.canvas.clientWidth - 2 * PAD);
    return from + Math.min(1, Math.max(0, share)) * (to - from);
  }

  // Each conflict in the first lane where it overlaps nothing; with more than fit, how many are on at a time.
  lay() {
    const room = this.canvas.clientHeight - AXIS - 6;
    const ends = [];
    this.bars = (this.conflicts ?? []).map((conflict) => {
      const pieces = conflict.periods.map(([a, b]) => {
        const [x0, x1] = [this.x(a), this.x(b)];
        return [x0, Math.max(x1, x0 + LEAST_BAR)];
      });
      const [first, last] = [pieces[0]?.[0] ?? 0, pieces[pieces.length - 1]?.[1] ?? 0];
      let lane = ends.findIndex((end) => end + 2 < first);
      if (lane < 0) lane = ends.length < room / LEAST_LANE + 1 ? ends.push(0) - 1 : 0;
      ends[lane] = last;
      return { conflict, pieces, lane };
    });
    this.lane = Math.min(LANE, Math.floor(room / Math.max(1, ends.length)));
    this.isDense = this.lane < LEAST_LANE;
    if (this.isDense) this.count();
    this.draw();
  }

  count() {
    const width = Math.ceil(this.canvas.clientWidth);
    const changes = new Int32Array(width + 2);
    for (const { pieces } of this.bars) {
      for (const [x0, x1] of pieces) {
        changes[Math.max(0, Math.floor(x0))] += 1;
        changes[Math.min(width, Math.ceil(x1))] -= 1;
      }
    }
    let on = 0;
    this.density = Array.from({ length: width }, (_, i) => (on += changes[i]));
    this.most = Math.max(1, ...this.density);
  }

  barAt({ offsetX: x, offsetY: y }) {
    if (this.isDense) return null;
    const lane = Math.floor((y - 4) / this.lane);
    const found = this.bars.find((bar) => bar.lane === lane && bar.pieces.some(([a, b]) => x >= a - 2 && x <= b + 2));
    return found?.conflict ?? null;
  }

  show(t, chosen = this.chosen) {
    this.t = t;
    this.chosen = chosen;
    this.slider.value = t;
    this.slider.setAttribute("aria-valuetext", `${moment(t)} UTC`);
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) {
      canvas.width = w;
      canvas.height = h;
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    this.drawAxis(context, width, height);
    if (this.isDense) this.drawDensity(context, height);
    else this.drawBars(context);
    context.fillStyle = colour("ink");
    context.fillRect(Math.round(this.x(this.t)) - 1, 0, 2, height - AXIS + 4);
  }

  drawAxis(context, width, height) {
    const [from, to] = this.span;
    const wanted = ((to - from) * 84) / Math.max(1, width - 2 * PAD);
    const step = STEPS.find((one) => one >= wanted) ?? STEPS[STEPS.length - 1];
    context.font = `12px ${colour("font")}`;
    context.textBaseline = "alphabetic";
    context.textAlign = "center";
    let before = "";
    for (let t = Math.ceil(from / step) * step; t <= to; t += step) {
      const x = Math.round(this.x(t));
      context.fillStyle = colour("line");
      context.fillRect(x, 0, 1, height - AXIS);
      const date = day(t).split(" ").slice(0, step < 2592000 ? 2 : 3).join(" ");
      const text = step >= 86400 || (date !== before && before !== "") ? date : clock(t, step < 60);
      before = date;
      const half = context.measureText(text).width / 2;
      context.fillStyle = colour("ink-soft");
      if (x - half > 0 && x + half < width) context.fillText(text, x, height - 4);
    }
  }

  drawDensity(context, height) {
    const room = height - AXIS - 6;
    context.fillStyle = colour("conflict");
    this.density.forEach((on, x) => {
      const tall = Math.ceil((on / this.most) * room);
      context.fillRect(x, room + 4 - tall, 1, tall);
    });
  }

  drawBars(context) {
    const thick = Math.max(2, this.lane - 3);
    for (const { conflict, pieces, lane } of this.bars) {
      const isOn = conflict.periods.some(([a, b]) => this.t >= a && this.t <= b);
      const isChosen = this.chosen === conflict.id;
      const y = 4 + lane * this.lane;
      context.globalAlpha = isOn || isChosen ? 1 : 0.5;
      context.fillStyle = context.strokeStyle = colour("conflict");
      if (pieces.length > 1) context.fillRect(pieces[0][0], y + thick / 2 - 0.5, pieces[pieces.length - 1][1] - pieces[0][0], 1);
      for (const [x0, x1] of pieces) {
        if (conflict.verdict === "conflict") context.fillRect(x0, y, x1 - x0, thick);
        else { // hollow: not decided to be one
          context.lineWidth = 1;
          context.setLineDash(conflict.verdict === "unresolved" ? [3, 2] : []);
          context.strokeRect(x0 + 0.5, y + 0.5, Math.max(1, x1 - x0 - 1), thick - 1);
          context.setLineDash([]);
        }
      }
      if (isChosen) {
        context.strokeStyle = colour("ink");
        context.lineWidth = 1.5;
        for (const [x0, x1] of pieces) context.strokeRect(x0 - 1.5, y - 1.5, x1 - x0 + 3, thick + 3);
      }
    }
    context.globalAlpha = 1;
  }
}
