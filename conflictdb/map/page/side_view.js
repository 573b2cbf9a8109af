// The side view: height bands over time, on the scale of the timeline, or along a track; the sea level; what passes above or
// below the selected track, and conflicts where bands meet.

import { element } from "./dom.js";
import { apartDuring, bandAt, bandsOf, LAYERS } from "./heights.js";
import { display } from "./display.js";
import { clock, grouped, labelOf, metres, NMI_M, printable } from "./format.js";
import { wayOf } from "./way.js";
import { colour, font, theme } from "./theme.js";

const MOST_BANDS = 300; // more would be one area
const MOST_SAID = 3;
const ROUND_M = 10; // heights up to about this are to scale, and those beyond by their digits
const TICKS = [0, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000];
const TICK_PX = 15;
const [TOP, FOOT] = [4, 4];
const AXIS = 16; // of metres along a track
const MARGIN = 0.06; // of heights, above and below
const PARTS = 48; // of a leg, along a track that turns or waits

const nameOf = ({ key }) => labelOf({ key, name: null }); // by its key, which is short
const whenOf = (span) => [...new Set(span.map((t) => clock(t, false)))].join(" – ");
const scaled = (m) => (Number.isFinite(m) ? Math.asinh(m / ROUND_M) : m);

export class SideView {
  // In a section; on the scale of a timeline. `passes(track)` brings when it passes others (passes.js). `on`: layers(set), mode(name), time(t).
  constructor(section, timeline, passes, on) {
    Object.assign(this, { section, timeline, passes, on });
    this.mode = null; // "time", "track", or null: not shown
    this.layers = new Set(LAYERS);
    this.scene = null; // { objects, conflicts, subject, pair }
    this.found = []; // what passes the subject: { object, spans: [{ span, apart }] }
    this.t = 0;
    this.asked = 0;
    this.canvas = element("canvas", { role: "img", "aria-label": "Heights" });
    this.picture = document.createElement("canvas"); // without the time that is shown
    this.said = element("p", { class: "said", role: "status" });
    this.choice = element("select", { "aria-label": "Side view along", change: () => this.show(this.choice.value) });
    this.chips = LAYERS.map((name) => element("button", { type: "button", class: "chip", "aria-pressed": "true", click: () => this.toggle(name) }, name));
    section.replaceChildren(
      element("div", { class: "side-head" }, this.choice, element("div", { role: "group", "aria-label": "Heights shown", class: "chips" }, ...this.chips), this.said),
      this.canvas);
    this.canvas.addEventListener("pointerdown", (event) => { this.canvas.setPointerCapture(event.pointerId); on.time(this.timeAt(event.offsetX)); });
    this.canvas.addEventListener("pointermove", (event) => { if (this.canvas.hasPointerCapture(event.pointerId)) on.time(this.timeAt(event.offsetX)); });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    timeline.onShown = () => { if (this.mode === "time") this.draw(); };
    theme.onChange(() => this.draw());
  }

  // "time", "track", or null.
  show(mode) {
    this.mode = mode;
    this.section.hidden = mode === null;
    this.on.mode(mode);
    this.offer();
    this.find();
  }

  toggle(name) {
    const layers = new Set(this.layers);
    if (!layers.delete(name)) layers.add(name);
    this.takeLayers(layers.size ? layers : new Set(LAYERS));
    this.on.layers(this.layers);
  }

  takeLayers(layers) {
    this.layers = layers;
    this.chips.forEach((chip, n) => chip.setAttribute("aria-pressed", layers.has(LAYERS[n])));
  }

  // objects and conflicts that the filter leaves; subject: the selected track, or null; pair: keys of the chosen conflict.
  take(scene) {
    const before = this.scene;
    this.scene = scene;
    if (this.mode === null) return;
    this.offer();
    const isSame = before && before.subject === scene.subject && before.version === scene.version && before.objects.length === scene.objects.length;
    if (isSame) this.draw();
    else this.find();
  }

  offer() {
    const { subject } = this.scene ?? {};
    const texts = [["time", "Over time"], ...(subject ? [["track", `Along ${nameOf(subject)}`]] : [])];
    this.choice.replaceChildren(...texts.map(([value, text]) => new Option(text, value, value === this.mode, value === this.mode)));
  }

  // Whether the view is along the subject.
  get isAlong() {
    return this.mode === "track" && this.scene?.subject != null;
  }

  // Finds what passes the subject, and draws it.
  async find() {
    this.found = [];
    this.problem = null;
    const { scene } = this;
    const asked = ++this.asked;
    if (this.mode === null || !scene) return;
    this.way = scene.subject && wayOf(scene.subject.motion);
    this.draw();
    const { subject } = scene;
    let passed = new Map();
    try {
      passed = await this.passes(subject);
    } catch (error) {
      if (asked === this.asked) this.problem = printable(error.message);
    }
    if (asked !== this.asked) return;
    this.found = scene.objects.filter(({ key }) => passed.has(key)).map((object) => (
      { object, spans: passed.get(object.key).map((span) => ({ span, apart: apartDuring(subject, object, span) })) }));
    this.say();
    this.draw();
  }

  // What passes above and below the subject, the nearest first.
  say() {
    const { subject, objects } = this.scene;
    if (!subject) {
      const isHigh = objects.some(({ floor, ceiling }) => floor !== null || ceiling !== null);
      const more = objects.length > MOST_BANDS ? ` ${MOST_BANDS} of ${grouped(objects.length)} objects are shown.` : "";
      this.said.textContent = objects.length === 0 ? "No object is left to show." : isHigh ? `Select an object to see what passes above and below it.${more}` : "No object has a limit of height.";
    } else if (this.problem) {
      this.said.textContent = `What passes ${printable(subject.key)} is not known: ${this.problem}.`;
    } else {
      const all = this.found.flatMap(({ object, spans }) => spans.filter(({ apart }) => apart).map(({ span, apart }) => ({ object, span, apart })))
        .sort((one, other) => one.apart[0] - other.apart[0] || one.span[0] - other.span[0]);
      const texts = all.slice(0, MOST_SAID).map(({ object, span, apart: [m, where] }) => `${printable(object.key)} ${metres(m)} ${where}, ${whenOf(span)}`);
      const rest = all.length > MOST_SAID ? `; ${all.length - MOST_SAID} more` : "";
      this.said.textContent = texts.length ? `${printable(subject.key)}: ${texts.join("; ")}${rest}.` : `Nothing passes above or below ${printable(subject.key)}.`;
    }
    this.canvas.setAttribute("aria-label", `Heights ${this.isAlong ? `along ${nameOf(subject)}` : "over time"}. ${this.said.textContent}`);
  }

  mark(t) {
    this.t = t;
    if (this.mode !== null) this.drawInstant();
  }

  // --- scales ----------------------------------------------------------------------------------------------------------

  // Pixels of an instant.
  x(t) {
    if (!this.isAlong) return this.timeline.x(t);
    const { subject } = this.scene;
    const whole = this.way(subject.end) || 1;
    return this.timeline.left + (this.way(Math.min(subject.end, Math.max(subject.start, t))) / whole) * this.timeline.width();
  }

  timeAt(x) {
    if (!this.isAlong) return this.timeline.timeAt(x);
    let [low, high] = [this.scene.subject.start, this.scene.subject.end];
    for (let n = 0; n < 40; n += 1) {
      const middle = (low + high) / 2;
      if (this.x(middle) < x) low = middle;
      else high = middle;
    }
    return low;
  }

  span() {
    return this.isAlong ? [this.scene.subject.start, this.scene.subject.end] : this.timeline.shown;
  }

  // Heights that are shown.
  range(shown) {
    const finite = shown.flatMap((object) => [...(object.floors ?? [object.floor]), ...(object.ceilings ?? [object.ceiling])])
      .filter((m) => m !== null && Number.isFinite(m)).map(scaled);
    const [low, high] = [Math.min(0, ...finite), Math.max(0, ...finite)];
    const margin = Math.max(0.3, MARGIN * (high - low));
    return [low - margin, high + margin];
  }

  // --- drawing ---------------------------------------------------------------------------------------------------------

  draw() {
    if (this.mode === null || !this.scene) return;
    const { canvas, picture, scene } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    for (const one of [canvas, picture]) {
      one.width = Math.round(width * ratio);
      one.height = Math.round(height * ratio);
    }
    const context = picture.getContext("2d", { willReadFrequently: true }); // in memory, as the overview
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const { subject, pair } = scene;
    const selected = new Set(subject ? [subject.key, ...pair] : []);
    const rank = ({ key }) => (selected.has(key) ? 0 : this.found.some(({ object }) => object.key === key) ? 1 : 2);
    const drawn = subject && this.isAlong ? scene.objects.filter((one) => rank(one) < 1) : scene.objects.filter((one) => !subject || rank(one) > 0).slice(0, MOST_BANDS);
    const bounds = subject ? [...scene.objects.filter((one) => rank(one) < 2)] : drawn;
    this.foot = height - FOOT - (this.isAlong ? AXIS : 0);
    const [low, high] = this.range(bounds);
    this.y = (m) => Math.min(this.foot + 40, Math.max(TOP - 40, TOP + ((high - scaled(m)) / (high - low)) * (this.foot - TOP)));
    this.drawGround(context, width);
    context.save();
    context.beginPath();
    context.rect(this.timeline.left - 2, TOP, width - this.timeline.left, this.foot - TOP);
    context.clip();
    const labels = [];
    for (const object of drawn) this.drawBands(context, object, bandsOf(object, this.span()), "object", subject ? [0.03, 0.18] : [0.1, 0.5]);
    for (const { object, spans } of subject ? this.found : []) {
      const hue = pair[1] === object.key ? "b" : pair[0] === object.key ? "a" : "object";
      for (const { span, apart } of spans) {
        const within = [Math.max(span[0], this.span()[0]), Math.min(span[1], this.span()[1])];
        if (within[0] > within[1]) continue;
        this.drawBands(context, object, bandsOf(object, within), hue, apart ? [0.35, 0.9] : [0.1, 0.5]);
        const text = apart ? `${nameOf(object)}, ${metres(apart[0])} ${apart[1]}` : nameOf(object);
        if (!selected.has(object.key)) labels.push({ object, t: (within[0] + within[1]) / 2, text, ink: apart ? "ink" : "ink-soft" });
      }
    }
    for (const key of selected) {
      const object = scene.objects.find((one) => one.key === key);
      const hue = key === (pair[1] ?? null) ? "b" : "a";
      if (!object || (this.isAlong && object !== subject)) continue;
      this.drawBands(context, object, bandsOf(object, this.span()), hue, [0.2, 1]);
      labels.unshift({ object, t: Math.max(this.span()[0], object.start ?? -Infinity), text: nameOf(object), ink: `${hue}-ink`, isFirst: true });
    }
    this.drawConflicts(context, selected);
    if (!subject) labels.push(...drawn.map((object) => ({ object, t: Math.max(this.span()[0], object.start ?? -Infinity), text: nameOf(object), ink: "ink-soft", isFirst: true })));
    labels.sort((one, other) => Number(other.isFirst ?? false) - Number(one.isFirst ?? false) || (other.ink === "ink") - (one.ink === "ink"));
    this.drawLabels(context, labels, width);
    context.restore();
    this.drawInstant();
  }

  // The sea below its level, and lines of heights.
  drawGround(context, width) {
    const { left } = this.timeline;
    const sea = this.y(0);
    context.fillStyle = colour("water");
    context.fillRect(left, sea, width - left, this.foot - sea);
    context.font = font("small");
    context.textAlign = "right";
    context.textBaseline = "middle";
    let [above, below] = [sea, sea];
    const rule = (m, y) => {
      context.fillStyle = colour(m === 0 ? "ink-soft" : "line");
      context.fillRect(left, Math.round(y), width - left, 1);
      context.fillStyle = colour("ink-soft");
      context.fillText(m === 0 ? "sea level" : `${m < 0 ? "−" : ""}${metres(Math.abs(m))}`, left - 6, y);
    };
    for (const m of TICKS) {
      for (const sign of m === 0 ? [1] : [1, -1]) {
        const y = this.y(sign * m);
        const isFree = m === 0 || (sign > 0 ? above - y : y - below) >= TICK_PX;
        if (!isFree || y < TOP + 5 || y > this.foot - 5) continue;
        rule(sign * m, y);
        if (sign > 0) above = y;
        if (sign < 0 || m === 0) below = y;
      }
    }
    if (this.isAlong) this.drawWay(context, width);
  }

  // Nautical miles, or kilometres, from the start of the track.
  drawWay(context, width) {
    const [unitM, unit] = display.isNautical ? [NMI_M, "nmi"] : [1000, "km"];
    const whole = this.way(this.scene.subject.end) / unitM;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((one) => (one / (whole || 1)) * this.timeline.width() >= 64) ?? 10_000;
    context.textAlign = "center";
    context.fillStyle = colour("ink-soft");
    for (let far = 0; far <= whole; far += step) {
      const text = `${Number(far.toFixed(1))} ${unit}`;
      const half = context.measureText(text).width / 2;
      context.fillText(text, Math.min(width - half, this.timeline.left + (far / whole) * this.timeline.width()), this.foot + AXIS / 2 + 2);
    }
  }

  drawBands(context, object, bands, hue, [fill, edge]) {
    context.fillStyle = context.strokeStyle = colour(hue);
    context.lineWidth = 1;
    context.setLineDash(hue === "b" ? [6, 3] : []);
    for (const band of bands) {
      const outline = this.outline(band);
      context.beginPath();
      outline.forEach(([x, y]) => context.lineTo(x, y));
      context.closePath();
      context.globalAlpha = fill;
      context.fill();
      context.globalAlpha = edge;
      context.stroke();
    }
    context.globalAlpha = 1;
    context.setLineDash([]);
  }

  // A band as a polygon, at least a pixel wide; a climb is straight in metres, not on the scale.
  outline({ t0, t1, floor, ceiling }) {
    const parts = this.isAlong || floor[0] !== floor[1] || ceiling[0] !== ceiling[1] ? PARTS : 1;
    const at = (ends, n) => (ends[0] === ends[1] ? ends[0] : ends[0] + (n / parts) * (ends[1] - ends[0]));
    const xs = Array.from({ length: parts + 1 }, (_, n) => this.x(Math.max(-1e15, Math.min(1e15, t0)) + (n / parts) * (Math.min(1e15, t1) - Math.max(-1e15, t0))));
    if (xs[parts] - xs[0] < 1) xs[parts] = xs[0] + 1;
    return [...xs.map((x, n) => [x, this.y(at(ceiling, n))]), ...xs.map((x, n) => [x, this.y(at(floor, n))]).reverse()];
  }

  // Where bands of a conflict meet.
  drawConflicts(context, selected) {
    const { conflicts, objects, pair } = this.scene;
    const known = new Map(objects.map((object) => [object.key, object]));
    const isShown = ({ a, b }) => (pair.length ? a === pair[0] && b === pair[1] : !selected.size || selected.has(a) || selected.has(b));
    for (const conflict of conflicts.filter(isShown).slice(0, MOST_BANDS)) {
      const [a, b] = [known.get(conflict.a), known.get(conflict.b)];
      if (!a || !b || conflict.change === "gone") continue;
      for (const [from, to] of conflict.periods) {
        const span = [Math.max(from, this.span()[0]), Math.min(to, this.span()[1])];
        for (const mine of span[0] <= span[1] ? bandsOf(a, span) : []) {
          for (const theirs of bandsOf(b, [mine.t0, mine.t1])) {
            const [own] = bandsOf(a, [theirs.t0, theirs.t1]);
            const common = {
              t0: theirs.t0, t1: theirs.t1, floor: [0, 1].map((n) => Math.max(own.floor[n], theirs.floor[n])), ceiling: [0, 1].map((n) => Math.min(own.ceiling[n], theirs.ceiling[n])),
            };
            if (common.floor[0] < common.ceiling[0] || common.floor[1] < common.ceiling[1]) this.drawBands(context, a, [common], "conflict", [0.55, 1]);
          }
        }
      }
    }
  }

  // Names in their bands, where there is room.
  drawLabels(context, labels, width) {
    const taken = [];
    context.font = font("small");
    context.textBaseline = "middle";
    context.textAlign = "left";
    context.lineJoin = "round";
    for (const { object, t, text, ink, isFirst } of labels) {
      const band = bandAt(object, t);
      if (!band) continue;
      const wide = context.measureText(text).width;
      const x = Math.min(width - wide - 4, Math.max(this.timeline.left + 4, isFirst ? this.x(t) + 4 : this.x(t) - wide / 2));
      const [top, low] = [Math.max(TOP, this.y(band[1])), Math.min(this.foot, this.y(band[0]))];
      const y = [Math.min(Math.max((top + low) / 2, TOP + 8), this.foot - 8), top + 8, low - 8].find((one) => (
        one > TOP + 4 && one < this.foot - 4 && !taken.some(([x0, y0, x1]) => x < x1 && x + wide > x0 && Math.abs(one - y0) < 13)));
      if (y === undefined) continue;
      taken.push([x - 4, y, x + wide + 4]);
      context.strokeStyle = colour("paper");
      context.lineWidth = 3;
      context.strokeText(text, x, y);
      context.fillStyle = colour(ink);
      context.fillText(text, x, y);
    }
  }

  // The picture and the time that is shown.
  drawInstant() {
    const { canvas, picture } = this;
    if (!picture.width || !this.scene) return;
    const context = canvas.getContext("2d");
    const ratio = window.devicePixelRatio || 1;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(picture, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colour("ink");
    context.fillRect(Math.round(this.x(this.t)) - 1, 0, 2, canvas.clientHeight - (this.isAlong ? AXIS : 0));
  }
}
