// Conflicts as bars over time, and the slider below them: of all the time there is, or of a part of it.

import { clock, day, moment } from "./format.js";
import { colour, theme } from "./theme.js";

const PAD = 10; // half of the slider's thumb, pixels: bars and slider have one scale; on the left are names (`left`)
const GUTTERS = [76, 148]; // room for names, on a narrow and on a wide page
const NARROW_PX = 560;
const AXIS = 18; // height of the axis
const LANE = 10; // height of a lane of bars and the gap below it; with many lanes less
const LEAST_LANE = 3;
const LEAST_BAR = 3; // width of a bar
const LEAST_S = 2; // of time that is shown
const ZOOM = 2; // by a button or a key
const WHEEL = 0.002; // by a pixel of a wheel, as a logarithm
const NEAR_PX = 3; // a pointer that is so near points at it
const STILL_PX = 6; // a pointer that moves by less only presses
const LINE_PX = 16; // of a wheel that counts lines
const ROOM = 0.1; // share of what is shown that is left beside an instant that comes into view
const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800,
  1209600, 2592000, 7776000, 31536000, 63072000, 157680000];

export class Timeline {
  // `onTime(t)` hears of the slider, `onChoose(conflict)` of a bar that is clicked; `buttons`: closer, wider, whole.
  constructor({ canvas, slider, buttons }, onTime, onChoose) {
    this.canvas = canvas;
    this.slider = slider;
    this.buttons = buttons;
    this.span = [0, 1]; // all the time there is
    this.shown = [0, 1]; // what is shown of it
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
    this.listenToPointers(onTime, onChoose);
    for (const one of [canvas, slider]) one.addEventListener("wheel", (event) => this.wheeled(event), { passive: false });
    buttons.closer.addEventListener("click", () => this.zoom(1 / ZOOM));
    buttons.wider.addEventListener("click", () => this.zoom(ZOOM));
    buttons.whole.addEventListener("click", () => this.showAll());
    new ResizeObserver(() => this.lay()).observe(canvas);
    theme.onChange(() => this.draw());
  }

  // One finger, or the mouse, chooses a bar or moves the time; two move and zoom what is shown.
  listenToPointers(onTime, onChoose) {
    const { canvas } = this;
    const held = new Map(); // pointer: where it is
    let isPinch = false;
    let pressed = null; // the bar that a pointer went down on, and where
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, event.offsetX);
      canvas.setPointerCapture(event.pointerId);
      isPinch ||= held.size > 1;
      const bar = isPinch ? null : this.barAt(event);
      pressed = bar && { bar, x: event.offsetX };
      if (!bar && !isPinch) onTime(this.timeAt(event.offsetX));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) {
        canvas.classList.toggle("on-bar", this.barAt(event) !== null);
        return;
      }
      const before = [...held.values()];
      held.set(event.pointerId, event.offsetX);
      if (pressed && Math.abs(event.offsetX - pressed.x) > STILL_PX) pressed = null;
      if (held.size === 2) this.pinched(before, [...held.values()]);
      else if (!isPinch && !pressed) onTime(this.timeAt(event.offsetX));
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, ({ pointerId }) => {
        if (pressed && end === "pointerup") onChoose(pressed.bar);
        pressed = null;
        held.delete(pointerId);
        isPinch &&= held.size > 0;
      });
    }
  }

  // Two fingers keep the instants that they are on.
  pinched(before, after) {
    const [first, second] = before.map((x) => this.timeAt(x));
    const [a, b] = after;
    if (Math.abs(b - a) < 1 || first === second) return;
    const perPixel = Math.abs((second - first) / (b - a));
    const from = (first + second) / 2 - ((a + b) / 2 - this.left) * perPixel;
    this.show([from, from + perPixel * this.width()]);
  }

  wheeled(event) {
    event.preventDefault();
    const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? LINE_PX : 1;
    const across = event.shiftKey && event.deltaX === 0 ? event.deltaY : event.deltaX;
    if (Math.abs(across) > Math.abs(event.deltaY) || event.shiftKey) {
      const by = (across * pixels * (this.shown[1] - this.shown[0])) / this.width();
      this.show([this.shown[0] + by, this.shown[1] + by]);
    } else {
      this.zoom(Math.exp(event.deltaY * pixels * WHEEL), this.pointedAt(event));
    }
  }

  // The instant that a pointer is at: of what is shown there, if something is, or else of the pixel, which may be hours.
  pointedAt(event) {
    const at = this.timeAt(event.offsetX);
    const conflict = this.barAt(event);
    if (Math.abs(this.x(this.t) - event.offsetX) <= NEAR_PX) return this.t;
    if (!conflict) return at;
    const within = conflict.periods.map(([a, b]) => Math.min(b, Math.max(a, at)));
    return within.reduce((best, t) => (Math.abs(t - at) < Math.abs(best - at) ? t : best));
  }

  // Shows so many times as much time; an instant, the one that is shown unless another one is given, stays where it is.
  zoom(factor, at = this.t) {
    const [from, to] = this.shown;
    const still = at >= from && at <= to ? at : (from + to) / 2;
    const [least, most] = [Math.min(LEAST_S, this.span[1] - this.span[0]) / (to - from), (this.span[1] - this.span[0]) / (to - from)];
    const by = Math.min(most, Math.max(least, factor));
    this.show([still - (still - from) * by, still + (to - still) * by]);
  }

  showAll() {
    this.show(this.span);
  }

  // Shows a part of the time, moved into what there is.
  show([from, to]) {
    const long = Math.min(this.span[1] - this.span[0], Math.max(to - from, LEAST_S));
    const start = Math.min(this.span[1] - long, Math.max(this.span[0], from));
    const isAll = long >= this.span[1] - this.span[0];
    this.shown = isAll ? [...this.span] : [start, start + long];
    [this.slider.min, this.slider.max] = this.shown;
    this.slider.value = this.t;
    this.buttons.wider.disabled = this.buttons.whole.disabled = isAll;
    this.buttons.closer.disabled = long <= LEAST_S;
    this.lay();
  }

  // Moves what is shown, if need be, so that an instant is in it.
  reveal(t) {
    const [from, to] = this.shown;
    if (t >= from && t <= to) return;
    const room = ROOM * (to - from);
    this.show(t > to ? [t - room, t - room + to - from] : [t + room - (to - from), t + room]);
  }

  // A step of the keyboard: about a two hundredth of what is shown.
  step() {
    const wanted = (this.shown[1] - this.shown[0]) / 200;
    return STEPS.find((step) => step >= wanted) ?? wanted;
  }

  // Takes what the filter leaves, and all the time there is; what is shown of it stays, unless it was all.
  take(conflicts, span) {
    const wasAll = this.shown[0] === this.span[0] && this.shown[1] === this.span[1];
    this.span = span;
    this.conflicts = conflicts;
    this.show(wasAll ? span : this.shown);
  }

  // Where the scale begins, pixels.
  get left() {
    return this.canvas.clientWidth < NARROW_PX ? GUTTERS[0] : GUTTERS[1];
  }

  width() {
    return Math.max(1, this.canvas.clientWidth - this.left - PAD);
  }

  // Pixels of an instant; a pixel beyond the edge where it is not shown.
  x(t) {
    const [from, to] = this.shown;
    return this.left + Math.min(this.width() + PAD + 1, Math.max(-PAD - 1, ((t - from) / (to - from)) * this.width()));
  }

  timeAt(x) {
    const [from, to] = this.shown;
    return from + Math.min(1, Math.max(0, (x - this.left) / this.width())) * (to - from);
  }

  // Each conflict in the first lane where it overlaps nothing; with more than fit, how many are on at a time.
  lay() {
    this.canvas.parentElement.style.setProperty("--gutter", `${this.left}px`);
    const room = this.canvas.clientHeight - AXIS - 6;
    const ends = [];
    const [from, to] = this.shown;
    const isSeen = ([a, b]) => a <= to && b >= from;
    this.bars = (this.conflicts ?? []).filter(({ periods }) => periods.some(isSeen)).map((conflict) => {
      const pieces = conflict.periods.filter(isSeen).map(([a, b]) => {
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
    this.onShown?.();
  }

  count() {
    const width = Math.ceil(this.canvas.clientWidth);
    const changes = new Int32Array(width + 2);
    for (const { pieces } of this.bars) {
      for (const [x0, x1] of pieces) {
        changes[Math.min(width, Math.max(0, Math.floor(x0)))] += 1;
        changes[Math.min(width, Math.max(0, Math.ceil(x1)))] -= 1;
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

  // Shows an instant, and which conflict is chosen.
  mark(t, chosen) {
    this.t = t;
    this.chosen = chosen;
    this.reveal(t);
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
    this.drawPart(context, width);
  }

  // Which part of all time is shown, if it is not all.
  drawPart(context, width) {
    const [[first, last], [from, to]] = [this.span, this.shown];
    if (to - from >= last - first) return;
    const at = (t) => this.left + ((t - first) / (last - first)) * this.width();
    context.fillStyle = colour("line");
    context.fillRect(this.left, 0, this.width(), 2);
    context.fillStyle = colour("object");
    context.fillRect(Math.min(at(from), width - PAD - 4), 0, Math.max(4, at(to) - at(from)), 2);
  }

  drawAxis(context, width, height) {
    const [from, to] = this.shown;
    const wanted = ((to - from) * 84) / this.width();
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
      const isGone = conflict.change === "gone"; // by a moved plan
      const isOn = !isGone && conflict.periods.some(([a, b]) => this.t >= a && this.t <= b);
      const isChosen = this.chosen === conflict.id;
      const y = 4 + lane * this.lane;
      context.globalAlpha = isOn || isChosen ? 1 : 0.5;
      context.fillStyle = context.strokeStyle = colour(isGone ? "ink-soft" : "conflict");
      if (pieces.length > 1) context.fillRect(pieces[0][0], y + thick / 2 - 0.5, pieces[pieces.length - 1][1] - pieces[0][0], 1);
      for (const [x0, x1] of pieces) {
        if (conflict.verdict === "conflict" && !isGone) context.fillRect(x0, y, x1 - x0, thick);
        else { // hollow: not decided to be one
          context.lineWidth = 1;
          context.setLineDash(isGone || conflict.verdict === "unresolved" ? [3, 2] : []);
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
