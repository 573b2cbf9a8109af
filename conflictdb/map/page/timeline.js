// Conflicts over time, a row for each with its name, or for each object; with many rows, how many are on at a time. Below are
// the calendar and the slider: of all the time there is, or of a part of it.

import { ticks } from "./calendar.js";
import { duration, grouped, moment, period, zone } from "./format.js";
import { lasting } from "./model.js";
import { fitted, fittedPair, namesOf } from "./pair_names.js";
import { colour, font, theme } from "./theme.js";

const PAD = 10; // half of the slider's thumb, pixels: bars and slider have one scale; on the left are names (`left`)
const GUTTERS = [[0, 128], [400, 176], [700, 240], [900, 280]]; // room for names, from so wide a page on
const ROW = 16; // height of a row
const TOP = 4;
const MOST_ROWS = 40;
const TICK_PX = 84;
const LEAST_BAR = 3; // width of a bar
const LEAST_S = 2; // of time that is shown
const ZOOM = 2; // by a button or a key
const WHEEL = 0.002; // by a pixel of a wheel, as a logarithm
const NEAR_PX = 3; // a pointer that is so near points at it
const STILL_PX = 6; // a pointer that moves by less only presses
const HELD_MS = 500; // a finger that stays so long reads what is there, and chooses nothing
const FINGER_PX = 36; // a hint is so far above one
const MOST_NAMED = 3; // pairs in a hint
const LINE_PX = 16; // of a wheel that counts lines
const ROOM = 0.1; // share of what is shown that is left beside an instant that comes into view
const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800,
  1209600, 2592000, 7776000, 31536000, 63072000, 157680000];

export class Timeline {
  // `onTime(t)` hears of the slider, `onChoose(conflict)` of a bar that is clicked, `onBrush(from, to)` of a part of the calendar
  // that is drawn over; `buttons`: closer, wider, whole. `view` scrolls the canvas of bars.
  constructor({ canvas, view, axis, tip, grouping, slider, buttons }, onTime, onChoose, onBrush) {
    this.canvas = canvas;
    Object.assign(this, { view, axis, tip, grouping });
    this.rows = []; // { texts, conflicts }
    this.brush = null; // the instants that the filter leaves, [from, to]
    this.objects = new Map();
    this.slider = slider;
    this.buttons = buttons;
    this.size = { width: 0, height: 0, foot: 0 }; // of the canvases, pixels: to measure them takes a layout of the page
    this.picture = document.createElement("canvas"); // of all bars, without the time that is shown
    this.drawn = ""; // what the picture shows
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
        this.hintNow();
      } else if (event.key === "Escape" && !this.tip.hidden) {
        event.stopPropagation();
        this.hint(null);
      }
    });
    for (const type of ["blur", "pointerdown"]) slider.addEventListener(type, () => this.hint(null));
    this.listenToPointers(onTime, onChoose);
    this.listenToBrush(onTime, onBrush);
    grouping.addEventListener("change", () => this.lay());
    for (const one of [canvas, axis, slider]) one.addEventListener("wheel", (event) => this.wheeled(event), { passive: false });
    buttons.closer.addEventListener("click", () => this.zoom(1 / ZOOM));
    buttons.wider.addEventListener("click", () => this.zoom(ZOOM));
    buttons.whole.addEventListener("click", () => this.showAll());
    new ResizeObserver(() => this.lay()).observe(axis);
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
      pressed = bar && { bar, x: event.offsetX, at: event.timeStamp };
      if (!bar && !isPinch) onTime(this.timeAt(event.offsetX));
      if (event.pointerType === "touch") this.hint(isPinch ? null : event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) {
        canvas.classList.toggle("on-bar", this.barAt(event) !== null);
        this.hint(event);
        return;
      }
      const before = [...held.values()];
      held.set(event.pointerId, event.offsetX);
      if (pressed && Math.abs(event.offsetX - pressed.x) > STILL_PX) pressed = null;
      if (held.size === 2) this.pinched(before, [...held.values()]);
      else if (!isPinch && !pressed) onTime(this.timeAt(event.offsetX));
      if (event.pointerType === "touch") this.hint(isPinch ? null : event);
    });
    canvas.addEventListener("pointerleave", () => this.hint(null));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, ({ pointerId, pointerType, timeStamp }) => {
        const isHeld = pressed && pointerType === "touch" && timeStamp - pressed.at > HELD_MS;
        if (pressed && !isHeld && end === "pointerup") onChoose(pressed.bar);
        if (pointerType === "touch") this.hint(null);
        pressed = null;
        held.delete(pointerId);
        isPinch &&= held.size > 0;
      });
    }
  }

  // Drawing over the calendar filters by time.
  listenToBrush(onTime, onBrush) {
    const { axis } = this;
    let from = null;
    const span = ({ offsetX }) => [this.timeAt(Math.min(from, offsetX)), this.timeAt(Math.max(from, offsetX))];
    axis.addEventListener("pointerdown", (event) => { axis.setPointerCapture(event.pointerId); from = event.offsetX; });
    axis.addEventListener("pointermove", (event) => {
      if (from === null || Math.abs(event.offsetX - from) <= STILL_PX) return;
      this.brush = span(event);
      this.draw();
    });
    axis.addEventListener("pointerup", (event) => {
      if (from === null) return;
      if (Math.abs(event.offsetX - from) > STILL_PX) onBrush(...span(event));
      else onTime(this.timeAt(event.offsetX));
      from = null;
    });
    axis.addEventListener("pointercancel", () => { from = null; });
  }

  // Says what is under the mouse or a finger: a conflict, or how many.
  hint(event) {
    this.say(event && this.hintAt(event), event?.clientX, event?.clientY - (event?.pointerType === "touch" ? FINGER_PX : 12));
  }

  // Says what is on at the instant that is shown, also to readers of the screen: for those who move it by keys.
  hintNow() {
    const on = (this.conflicts ?? []).filter((one) => this.isOn(one));
    const named = on.slice(0, MOST_NAMED).map((one) => namesOf(one, this.objects).join(" and "));
    if (on.length > MOST_NAMED) named.push(`${grouped(on.length - MOST_NAMED)} more`);
    const said = on.length === 0 ? null : on.length === 1 ? hintOf(on[0], this.objects) : [`${grouped(on.length)} at once`, named.join("; ")];
    const { left, top } = this.view.getBoundingClientRect();
    this.say(said, left + this.x(this.t), top);
    this.slider.setAttribute("aria-valuetext", [`${moment(this.t)} ${zone(this.t)}`, ...(said ?? ["nothing is on"])].join(", "));
  }

  // Shows a title and a text above a place of the page; null hides them.
  say(said, x, y) {
    const { tip } = this;
    tip.hidden = said === null;
    if (tip.hidden) return;
    const [title, text] = said;
    tip.replaceChildren(Object.assign(document.createElement("b"), { textContent: title }), document.createElement("br"), text);
    const { offsetWidth: width, offsetHeight: height } = tip;
    tip.style.left = `${Math.max(4, Math.min(innerWidth - width - 4, x + 12))}px`;
    tip.style.top = `${Math.max(4, y - height)}px`;
  }

  // A title and a text; null where nothing is.
  hintAt(event) {
    if (this.isDense) {
      const n = event.offsetX < this.left ? undefined : this.density[Math.floor(event.offsetX)];
      return n === undefined ? null : [`${grouped(n)} at once`, `${moment(this.timeAt(event.offsetX))} ${zone(this.t)}`];
    }
    const conflict = this.barAt(event);
    return conflict && hintOf(conflict, this.objects);
  }

  // Whether a conflict is on at the instant that is shown.
  isOn({ periods, change }) {
    return change !== "gone" && periods.some(([a, b]) => this.t >= a && this.t <= b);
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

  // On names the wheel moves rows, elsewhere the time.
  wheeled(event) {
    if (event.target === this.canvas && event.offsetX < this.left && this.view.scrollHeight > this.view.clientHeight) return;
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
  // brush: the instants that the filter leaves, [from, to], or null.
  take(conflicts, span, brush, objects) {
    this.brush = brush;
    const wasAll = this.shown[0] === this.span[0] && this.shown[1] === this.span[1];
    this.span = span;
    this.conflicts = conflicts;
    this.objects = objects;
    this.show(wasAll ? span : this.shown);
  }

  // Where the scale begins, pixels.
  get left() {
    return GUTTERS.findLast(([from]) => this.size.width >= from)[1];
  }

  width() {
    return Math.max(1, this.size.width - this.left - PAD);
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

  // A row for each conflict, or each object, with a period in the time that is shown; with more than fit, how many are on at a time.
  lay() {
    const { axis, canvas, view } = this;
    this.size = { width: axis.clientWidth, foot: axis.clientHeight };
    axis.parentElement.style.setProperty("--gutter", `${this.left}px`);
    canvas.style.width = `${this.size.width}px`;
    const [from, to] = this.shown;
    const isSeen = ([a, b]) => a <= to && b >= from;
    const seen = (this.conflicts ?? []).filter(({ periods }) => periods.some(isSeen));
    const isByObject = this.grouping.value === "object";
    const rows = new Map();
    const add = (name, texts, conflict) => {
      if (!rows.has(name)) rows.set(name, { texts, conflicts: [] });
      rows.get(name).conflicts.push(conflict);
    };
    for (const conflict of seen) {
      const names = namesOf(conflict, this.objects);
      if (isByObject) [conflict.a, conflict.b].forEach((key, n) => add(key, [names[n]], conflict));
      else add(conflict, names, conflict);
    }
    this.isDense = rows.size > MOST_ROWS;
    this.rows = this.isDense ? [] : [...rows.values()];
    this.lane = ROW;
    const bar = (conflict, lane) => ({
      conflict, lane,
      pieces: conflict.periods.filter(isSeen).map(([a, b]) => {
        const [x0, x1] = [this.x(a), this.x(b)];
        return [x0, Math.max(x1, x0 + LEAST_BAR)];
      }),
    });
    this.bars = this.rows.flatMap(({ conflicts }, lane) => conflicts.map((conflict) => bar(conflict, lane)));
    this.size.height = Math.max(view.clientHeight, this.isDense ? 0 : 2 * TOP + this.rows.length * ROW);
    canvas.style.height = `${this.size.height}px`;
    if (this.isDense) this.count(seen.flatMap(({ periods }) => periods.filter(isSeen)));
    const what = this.isDense ? `${grouped(seen.length)} conflicts over time; at most ${grouped(this.most)} at once`
      : isByObject ? `Conflicts over time, ${this.rows.length} rows of objects` : "Conflicts over time, as in the list";
    canvas.setAttribute("aria-label", what);
    this.draw();
    this.onShown?.();
  }

  // The most that are on at one instant of each pixel, whatever the width: ends that touch count as one instant.
  count(periods) {
    const width = Math.ceil(this.size.width);
    const starts = Float64Array.from(periods, ([a]) => a).sort();
    const ends = Float64Array.from(periods, ([, b]) => b).sort();
    this.density = new Array(width).fill(0);
    let [on, pixel, next] = [0, 0, 0];
    const goTo = (t) => {
      const at = Math.min(width - 1, Math.max(0, Math.floor(this.x(t))));
      if (at > pixel) this.density.fill(on, pixel + 1, at + 1);
      pixel = Math.max(pixel, at);
    };
    for (const start of starts) {
      for (; ends[next] < start; next += 1) {
        goTo(ends[next]);
        on -= 1;
      }
      goTo(start);
      on += 1;
      this.density[pixel] = Math.max(this.density[pixel], on);
    }
    for (; next < ends.length; next += 1) {
      goTo(ends[next]);
      on -= 1;
    }
    this.most = Math.max(1, ...this.density);
  }

  barAt({ offsetX: x, offsetY: y }) {
    if (this.isDense) return null;
    const lane = Math.floor((y - TOP) / ROW);
    if (x < this.left) return this.rows[lane]?.conflicts[0] ?? null; // its name
    const found = this.bars.find((bar) => bar.lane === lane && bar.pieces.some(([a, b]) => x >= a - 2 && x <= b + 2));
    return found?.conflict ?? null;
  }

  // Shows an instant, and which conflict is chosen.
  mark(t, chosen) {
    this.t = t;
    if (this.chosen !== chosen) {
      this.chosen = chosen;
      this.revealRow();
    }
    this.reveal(t);
    this.slider.value = t;
    this.slider.setAttribute("aria-valuetext", `${moment(t)} ${zone(t)}`);
    this.drawInstant();
  }

  // Scrolls to the row of the chosen conflict.
  revealRow() {
    const { view } = this;
    const row = this.rows.findIndex(({ conflicts }) => conflicts.some(({ id }) => id === this.chosen));
    const [top, low] = [TOP + row * ROW, TOP + (row + 1) * ROW];
    if (row >= 0 && (top < view.scrollTop || low > view.scrollTop + view.clientHeight)) view.scrollTop = top - view.clientHeight / 2;
  }

  // Draws all anew.
  draw() {
    this.drawn = "";
    this.drawInstant();
  }

  // Draws the time that is shown; the rest only where other conflicts are on.
  drawInstant() {
    const { width, height, foot } = this.size;
    if (!width) return;
    const wanted = this.isDense ? "many" : `${this.chosen} ${this.bars.map(({ conflict }) => (this.isOn(conflict) ? 1 : 0)).join("")}`;
    if (wanted !== this.drawn) {
      this.drawn = wanted;
      const bars = this.contextOf(this.picture, width, height);
      const axis = this.contextOf(this.axis, width, foot);
      this.drawAxis(bars, axis, width, height);
      if (this.isDense) this.drawDensity(bars, height);
      else this.drawBars(bars);
      if (this.brush) this.drawBrush(bars, axis, height);
      this.drawPart(axis);
    }
    const context = this.contextOf(this.canvas, width, height);
    context.drawImage(this.picture, 0, 0, width, height);
    context.fillStyle = colour("ink");
    context.fillRect(Math.round(this.x(this.t)) - 1, 0, 2, height);
  }

  // A cleared canvas of a size, in pixels of the page.
  contextOf(canvas, width, height) {
    const ratio = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const context = canvas.getContext("2d", { willReadFrequently: true }); // in memory, as the overview
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  // Which part of all time is shown, if it is not all.
  drawPart(context) {
    const [[first, last], [from, to]] = [this.span, this.shown];
    if (to - from >= last - first) return;
    const at = (t) => this.left + ((t - first) / (last - first)) * this.width();
    const y = this.size.foot - 2;
    context.fillStyle = colour("line");
    context.fillRect(this.left, y, this.width(), 2);
    context.fillStyle = colour("object");
    context.fillRect(Math.min(at(from), this.left + this.width() - 4), y, Math.max(4, at(to) - at(from)), 2);
  }

  drawAxis(bars, axis, width, height) {
    axis.font = font("small");
    axis.textBaseline = "alphabetic";
    axis.textAlign = "center";
    for (const { t, text } of ticks(this.shown, this.width() / TICK_PX)) {
      const x = Math.round(this.x(t));
      bars.fillStyle = colour("line");
      bars.fillRect(x, 0, 1, height);
      const half = axis.measureText(text).width / 2;
      axis.fillStyle = colour("ink-soft");
      if (x - half > this.left - 40 && x + half < width) axis.fillText(text, x, 14);
    }
  }

  // What the filter leaves of the time.
  drawBrush(bars, axis, height) {
    const [from, to] = this.brush.map((t) => this.x(t));
    axis.fillStyle = colour("object");
    axis.globalAlpha = 0.25;
    axis.fillRect(from, 0, Math.max(2, to - from), this.size.foot);
    axis.globalAlpha = 1;
    bars.fillStyle = colour("paper");
    bars.globalAlpha = 0.65;
    bars.fillRect(this.left, 0, Math.max(0, from - this.left), height);
    bars.fillRect(to, 0, Math.max(0, this.left + this.width() - to), height);
    bars.globalAlpha = 1;
  }

  // How many are on at a time: darker and higher where there are more.
  drawDensity(context, height) {
    const room = height - 2 * TOP - 4;
    context.fillStyle = colour("conflict");
    this.density.forEach((on, x) => {
      if (x < this.left - 1 || !on) return;
      const tall = Math.ceil((on / this.most) * room);
      context.globalAlpha = 0.35 + (0.65 * on) / this.most;
      context.fillRect(x, height - TOP - tall, 1, tall);
    });
    context.globalAlpha = 1;
    context.font = font("small");
    context.textAlign = "right";
    context.textBaseline = "middle";
    const halves = this.most >= 4 && room > 48 ? [0, Math.round(this.most / 2), this.most] : [0, this.most];
    for (const n of halves) {
      const y = height - TOP - (n / this.most) * room;
      context.fillStyle = colour("line");
      context.fillRect(this.left, Math.round(y), this.width(), 1);
      context.fillStyle = colour("ink-soft");
      context.fillText(n === this.most ? `${grouped(n)} at once` : grouped(n), this.left - 6, Math.min(height - 8, Math.max(8, y)));
    }
  }

  // The name of a row, each part cut to its share of the room.
  drawName(context, { texts }, y) {
    const room = this.left - 14;
    const between = texts.length > 1 ? " · " : "";
    const rest = room - context.measureText(between).width;
    const widthOf = (text) => context.measureText(text).width;
    const wide = texts.map(widthOf);
    const least = Math.min(...wide, rest / texts.length);
    const rooms = wide.map((own) => (wide.length > 1 && own > least ? Math.max(rest / 2, rest - Math.min(...wide)) : rest));
    const cut = texts.length > 1 ? fittedPair(widthOf, texts, rooms) : [fitted(widthOf, texts[0], rest)];
    context.fillText(cut.join(between), this.left - 8, y);
  }

  drawBars(context) {
    const thick = ROW - 6;
    context.font = font("small");
    context.textAlign = "right";
    context.textBaseline = "middle";
    this.rows.forEach((row, lane) => {
      const isChosen = row.conflicts.some(({ id }) => id === this.chosen);
      const isOn = row.conflicts.some((one) => this.isOn(one));
      context.fillStyle = colour(isChosen ? "ink" : isOn ? "conflict-ink" : "ink-soft");
      this.drawName(context, row, TOP + (lane + 0.5) * ROW);
    });
    for (const { conflict, pieces, lane } of this.bars) {
      const isGone = conflict.change === "gone"; // by a moved plan
      const isOn = this.isOn(conflict);
      const isChosen = this.chosen === conflict.id;
      const y = TOP + lane * ROW + 3;
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

// A title and a text on a conflict.
function hintOf(conflict, objects) {
  const lasts = lasting(conflict);
  const count = conflict.periods.length > 1 ? `, ${conflict.periods.length} periods` : "";
  const long = Number.isFinite(lasts) ? ` · ${duration(lasts)}${count}` : "";
  return [namesOf(conflict, objects).join(" and "), `${period(conflict.start, conflict.end, null)}${long} · ${conflict.verdict}`];
}
