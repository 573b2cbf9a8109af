// What if a track departed earlier or later, or went higher or lower: which departures are clear, what forbids the others, and
// what sliders change.

import { element } from "./dom.js";
import { capital, counted, metres, moment, printable } from "./format.js";
import { moved, statement } from "./moved_plan.js";
import { withWaypoint } from "./moved_waypoint.js";
import { unpackPieces, withMargin } from "./near.js";
import { laterBy, LONGEST_MARGIN_S, PlanMove, RANGES, SECOND } from "./plan_move.js";
import { DepartureStrip } from "./strip.js";
import { limitsOf, union, WhatIf } from "./what_if.js";

const [FIRST_S, WIDER_S] = [3600, 10800]; // shown first; and where no departure within it is clear
const MOST_STRETCHES = 60;

// ", 20 m higher".
const higherBy = (m) => (m === 0 ? "" : `, ${metres(Math.abs(m))} ${m > 0 ? "higher" : "lower"}`);

const MOST_UP_M = 20_000;
const seconds = (us) => Math.round(us / SECOND) * SECOND;
const isIn = (spans, us) => spans.some(([low, high]) => low <= us && high >= us);

// The nearest clear departure from one on, 1: later, -1: earlier; at a whole minute of the clock (`plannedUs`: of the planned one), or else a
// whole second, if that one is clear.
function clearFrom(spans, us, way, plannedUs) {
  const outward = way > 0 ? Math.ceil : Math.floor;
  const whole = [60 * SECOND, SECOND].map((step) => outward((plannedUs + us) / step) * step - plannedUs);
  return [...whole, us].find((one) => !isIn(spans, one)) ?? us;
}

// By how much a departure misses forbidden ones, microseconds.
const marginAt = (spans, us) => Math.min(Infinity, ...spans.map(([low, high]) => Math.max(low - us, us - high)));

// Forbidden departures by keys within a horizon, of those within a longer one.
function within(horizonUs, forbidden) {
  const cut = (spans) => spans.filter(([low, high]) => low <= horizonUs && high >= -horizonUs)
    .map(([low, high]) => [Math.max(low, -horizonUs), Math.min(high, horizonUs)]);
  return new Map([...forbidden].map(([key, spans]) => [key, cut(spans)]).filter(([, spans]) => spans.length > 0));
}

// What forbids departures from one end of the range to the other, in order: [{ from, to, keys }], microseconds.
export function stretchesOf(forbidden) {
  const ends = [...forbidden.values()].flat().flatMap(([low, high]) => [low, high + 1]);
  const cuts = [...new Set(ends)].sort((a, b) => a - b);
  return cuts.slice(0, -1).map((from, n) => ({
    from, to: cuts[n + 1] - 1,
    keys: [...forbidden].filter(([, spans]) => spans.some(([low, high]) => low <= from && high >= from)).map(([key]) => key),
  })).filter(({ keys }) => keys.length > 0);
}

export class Departure extends PlanMove {
  // `on`: as PlanMove, and range(track, s) hears by how much it may be moved, change(plan) of a moved plan (null: as planned),
  // waypoints(track, waypoint) shows its waypoints (null: none), one of them elsewhere.
  constructor(container, source, kernel, on) {
    super(container, on);
    this.canvas = element("canvas", { role: "img", "aria-label": "Departures in conflict, by what they meet" });
    this.strip = new DepartureStrip(this.canvas, (us) => this.moveTo(seconds(us)));
    this.source = source;
    this.kernel = kernel; // loads it
    this.rangeS = FIRST_S;
    this.isWidened = false; // rather than chosen so
    this.mayWiden = false;
    this.laterUs = 0;
    this.upM = 0;
    this.waypoint = null; // one that is elsewhere: [n, lon, lat]
  }

  // Asks about a track of a scene.
  async open(track, scene, hue = "a") {
    this.scene = scene;
    this.hue = hue; // of the track: "a" or "b"
    this.key = track.key;
    this.track = track;
    this.laterUs = this.upM = 0;
    this.waypoint = this.whatIf = null;
    this.mayWiden = true;
    if (this.isWidened) [this.rangeS, this.isWidened] = [FIRST_S, false];
    this.summary = element("p", { class: "said", role: "status" });
    this.slider = element("input", { type: "range", step: "any", "aria-label": "Departure", input: () => this.moveTo(seconds(1e6 * this.slider.value)), keydown: (event) => this.pressed(event) });
    this.range = this.rangeChoice(() => this.widen(Number(this.range.value)));
    this.height = element("input", { type: "range", step: 1, "aria-label": "Height", input: () => this.moveTo(this.laterUs, Number(this.height.value)) });
    this.heights = element("div", { class: "heights", hidden: true }, element("span", { class: "soft" }, "Height"), this.height);
    this.makeWriting();
    this.buttons = {
      earlier: element("button", { type: "button", click: () => this.moveTo(this.clear.earlier) }),
      planned: element("button", { type: "button", click: () => this.reset() }, "As planned"),
      later: element("button", { type: "button", click: () => this.moveTo(this.clear.later) }),
    };
    this.stretches = element("ol");
    this.copied = element("p", { class: "soft", role: "status" });
    this.text = element("textarea", { "aria-label": "The moved plan", readonly: true, hidden: true, spellcheck: "false" });
    this.copies = element("div", { class: "copies" },
      element("button", { type: "button", class: "plain", click: () => this.copy("SQL", (plan) => statement(this.scene, plan, this.laterUs, this.upM, this.waypoint)) }, "Copy as SQL"),
      element("button", { type: "button", class: "plain", click: () => this.copy("GeoJSON", (plan) => JSON.stringify(moved(plan, this.laterUs, this.upM, this.waypoint), null, 1)) }, "Copy as GeoJSON"));
    this.more = element("div", { hidden: true },
      this.canvas, this.slider, this.heights,
      element("div", { class: "clear" }, this.buttons.earlier, this.buttons.planned, this.buttons.later),
      element("details", {}, element("summary", {}, "What forbids which departures"), this.stretches),
      this.writing, this.stored, this.copies,
      this.copied, this.text);
    this.fill("departs", hue, element("div", { class: "choices" }, this.range, this.marginChoice(() => this.remargin())), this.summary, this.more);
    await this.read();
  }

  hideHandles() {
    this.on.waypoints(null);
  }

  // Of a scene that has changed.
  readAgain(track) {
    this.track = track;
    return this.read();
  }

  // Reads the pieces, and computes which departures are in conflict; the plan stays moved as it is.
  async read() {
    const asked = ++this.asked;
    this.summary.textContent = "Computing …";
    let whatIf;
    try {
      const { m } = this.margin;
      const [kernel, pieces] = await Promise.all([this.kernel(), this.source.pieces(this.key, this.rangeS + LONGEST_MARGIN_S, m)]);
      if (asked !== this.asked) return;
      whatIf = new WhatIf(kernel, unpackPieces(pieces), this.key);
      if (whatIf.refusal === null) this.keep(whatIf);
    } catch (error) {
      if (asked === this.asked) this.say(`Not known: ${printable(error.message)}.`);
      return;
    }
    if (whatIf.refusal !== null) {
      this.say(`Not shown: ${printable(whatIf.refusal)}.`);
      return;
    }
    if (this.whatIf?.digest !== whatIf.digest) this.waypoint = null; // of another plan
    this.whatIf = whatIf;
    this.elsewhere = null;
    this.planned = new Set(whatIf.conflicts(0).map(({ other }) => other));
    this.heights.hidden = !whatIf.mayRise;
    if (!whatIf.mayRise) this.upM = 0;
    this.limitHeight(whatIf);
    this.showForbidden();
    const isHopeless = this.planned.size > 0 && this.clear.earlier === null && this.clear.later === null;
    if (isHopeless && this.mayWiden && this.rangeS < WIDER_S) {
      return this.widen(WIDER_S, false);
    }
    if (isHopeless && this.isWidened) return this.widen(FIRST_S);
    this.mayWiden = false;
    [this.slider.min, this.slider.max] = [-this.rangeS, this.rangeS];
    this.on.range(this.track, this.rangeS);
    this.on.waypoints(this.track, this.waypoint);
    this.more.hidden = false;
    this.moveTo(Math.min(1e6 * this.rangeS, Math.max(-1e6 * this.rangeS, this.laterUs)));
  }

  // Shows departures earlier and later by so many seconds.
  widen(rangeS, isChosen = true) {
    this.mayWiden = false;
    this.isWidened = !isChosen;
    this.rangeS = this.range.value = rangeS;
    return this.read();
  }

  // With a margin, forbidden are departures that come nearer than the separations and the margin.
  keep(whatIf) {
    const { kernel, pack } = whatIf;
    this.kept = this.hasMargin ? new WhatIf(kernel, withMargin(pack, this.margin), this.key) : whatIf;
  }

  // With another margin.
  remargin() {
    if (this.more.hidden || this.margin.m > this.whatIf.pack.margin_m) return this.read();
    this.keep(this.whatIf);
    this.elsewhere = null;
    this.rewrite();
  }

  // As high and as low as whatever is around, and clear of it.
  limitHeight({ heights: [low, high], plan }) {
    const ends = limitsOf(plan);
    if (!ends.length) return;
    const [floor, ceiling] = [Math.min(...ends), Math.max(...ends)];
    const thick = Math.max(1, ceiling - floor);
    [this.height.min, this.height.max] = [Math.max(-MOST_UP_M, Math.floor(low - floor - thick)), Math.min(MOST_UP_M, Math.ceil(high - floor + thick))];
  }

  // Which departures are in conflict at the height that is shown.
  showForbidden() {
    this.shownUpM = this.upM;
    const [horizonUs, knownUs] = [this.rangeS, this.rangeS + LONGEST_MARGIN_S].map((s) => 1e6 * s);
    const known = this.whatIf.forbidden(knownUs, this.upM);
    const forbidden = within(horizonUs, known);
    this.known = { spans: union([...known.values()].flat()), us: knownUs };
    this.nearer = this.hasMargin ? this.kept.forbidden(horizonUs, this.upM) : forbidden;
    const kept = union([...this.nearer.values()].flat());
    const now = kept.find(([low, high]) => low <= 0 && high >= 0);
    const shown = (us) => (Math.abs(us) <= horizonUs ? us : null);
    const planned = Math.round(1e6 * this.track.start);
    this.clear = { earlier: now ? shown(clearFrom(kept, now[0] - 1, -1, planned)) : null, later: now ? shown(clearFrom(kept, now[1] + 1, 1, planned)) : null };
    for (const [name, us] of Object.entries(this.clear)) {
      this.buttons[name].disabled = us === null;
      this.buttons[name].textContent = us !== null ? this.departsAt(us, laterBy(us)) : now ? `none ${name}` : "–";
      if (us !== null) this.buttons[name].setAttribute("aria-label", `Clear ${laterBy(us)}: ${this.departsAt(us)}`);
      else this.buttons[name].removeAttribute("aria-label");
    }
    this.strip.take(forbidden, 1e6 * this.rangeS);
    this.list(stretchesOf(forbidden));
  }

  // Whether one departure is meant, so that it has a clock time.
  get isOne() {
    return (this.track.spans?.length ?? 1) === 1;
  }

  // "06:07 (1 h 8 min earlier)", or "departs 06:07", outward to seconds.
  departsAt(us, by = null) {
    if (!this.isOne) return by ?? laterBy(us);
    const t = this.track.start + us / 1e6;
    const at = moment(us < 0 ? Math.floor(t + 1e-6) : Math.ceil(t - 1e-6), this.track.start).replace(/:00$/, "");
    return by === null ? `departs ${at}` : `${at} (${by})`;
  }

  between(from, to) {
    const [first, last] = [Math.floor(this.track.start + from / 1e6), Math.ceil(this.track.start + to / 1e6)];
    return `${moment(first, this.track.start)} to ${moment(last, first)}`;
  }

  // In other units, another zone, or with another margin.
  rewrite() {
    if (!this.isOpen || this.more.hidden) return;
    this.offerMargins();
    this.showForbidden();
    this.moveTo(this.laterUs);
  }

  // "clear by 5 min 36 s", to the next departure that is forbidden, or by a distance; "clear, no margin". `nearer`: of a plan with a
  // waypoint elsewhere.
  clearText(nearer) {
    if (this.waypoint !== null) return super.clearText(nearer);
    if (this.margin.m) return super.clearText([...this.nearer].filter(([, spans]) => isIn(spans, this.laterUs)).map(([key]) => key));
    const { spans, us } = this.known;
    const [gapUs, knownUs] = [marginAt(spans, this.laterUs), us - Math.abs(this.laterUs)];
    const by = Math.floor(Math.min(gapUs, knownUs) / SECOND);
    return by < 1 ? "clear, no margin" : `clear by ${laterBy(by * SECOND).replace(/ later$/, "")}${gapUs > knownUs ? " or more" : ""}`;
  }

  say(text) {
    this.on.waypoints(null);
    this.summary.textContent = text;
    this.more.hidden = true;
    this.on.change(null);
  }

  list(stretches) {
    this.stretches.replaceChildren(...stretches.slice(0, MOST_STRETCHES).map(({ from, to, keys }) => element("li", {},
      element("button", { type: "button", class: "link", click: () => this.moveTo(to - from < SECOND ? from : seconds((from + to) / 2)) },
        this.isOne ? this.between(from, to) : `${laterBy(Math.floor(from / SECOND) * SECOND)} to ${laterBy(Math.ceil(to / SECOND) * SECOND)}`),
      " ", ...keys.flatMap((key, n) => [n > 0 ? ", " : "", element("bdi", {}, printable(key))]))));
    if (stretches.length > MOST_STRETCHES) this.stretches.append(element("li", {}, `and ${stretches.length - MOST_STRETCHES} more`));
    if (!stretches.length) this.stretches.append(element("li", {}, "Nothing: all are clear."));
  }

  moveTo(us, upM = this.upM) {
    [this.laterUs, this.upM] = [us, upM];
    this.copied.textContent = ""; // of another plan
    this.text.hidden = true;
    if (upM !== this.shownUpM) this.showForbidden();
    this.height.value = upM;
    this.height.setAttribute("aria-valuetext", upM === 0 ? "as planned" : higherBy(upM).slice(2));
    this.slider.value = us / 1e6;
    this.slider.setAttribute("aria-valuetext", us === 0 ? laterBy(us) : this.departsAt(us, laterBy(us)));
    this.strip.mark(us);
    // Which departures are clear is known of the planned way.
    for (const one of [this.canvas, this.buttons.earlier, this.buttons.later]) one.hidden = this.waypoint !== null;
    if (this.waypoint === null) this.show(this.whatIf.conflicts(us, upM));
    else if (this.source.isLive) this.probe();
    else this.showElsewhere();
  }

  // Computes the conflicts of a plan with another waypoint, where there is no server to ask: the page has all pieces then.
  showElsewhere() {
    const { waypoint, laterUs, upM } = this;
    try {
      if (this.elsewhere?.waypoint !== waypoint) {
        const { kernel } = this.whatIf;
        const there = ({ pack }) => new WhatIf(kernel, withWaypoint(kernel, pack, this.key, waypoint), this.key);
        const whatIf = there(this.whatIf);
        this.elsewhere = { waypoint, whatIf, kept: this.hasMargin ? there(this.kept) : whatIf };
      }
      const { whatIf, kept } = this.elsewhere;
      if (whatIf.refusal !== null) throw new Error(whatIf.refusal);
      const conflicts = whatIf.conflicts(laterUs, upM);
      this.show(conflicts, this.hasMargin && !conflicts.length ? kept.conflicts(laterUs, upM).map(({ other }) => other) : []);
    } catch (error) {
      this.summary.textContent = `Not known: ${printable(error.message)}.`;
    }
  }

  // As it is planned.
  reset() {
    this.waypoint = null;
    this.on.waypoints(this.track);
    this.moveTo(0, 0);
  }

  // Moves one waypoint to a place, degrees; others are as planned.
  moveWaypoint(n, lon, lat) {
    this.waypoint = [n, lon, lat];
    this.moveTo(this.laterUs);
  }

  get what() {
    return { key: this.key, plan: this.whatIf.digest, later_us: this.laterUs, up_m: this.upM, waypoint: this.waypoint };
  }

  // What departures in their planned way meet is computed here.
  get asksServer() {
    return this.waypoint !== null && this.isOpen;
  }

  // Shows the conflicts of the plan as it is moved.
  show(conflicts, nearer = []) {
    const { laterUs: us, upM } = this;
    this.summary.textContent = this.told(conflicts, nearer);
    const isPlanned = us === 0 && upM === 0 && this.waypoint === null;
    // A schedule says itself when its voyages depart.
    const isScheduled = us !== 0 && "schedule" in this.whatIf.plan.properties;
    this.offerWriting(!isPlanned && !isScheduled);
    this.copies.hidden = isScheduled;
    this.on.change(isPlanned ? null : { key: this.key, laterUs: us, upM, waypoint: this.waypoint, conflicts });
  }

  // "4 min 10 s later: 2 fewer, none new; 1 left."
  told(conflicts, nearer) {
    const by = this.laterUs === 0 || !this.isOne ? this.moveText() : `${this.departsAt(this.laterUs)}, ${this.moveText()}`;
    const said = capital(by);
    if (this.laterUs === 0 && this.upM === 0 && this.waypoint === null) return `${said}: ${conflicts.length ? counted(conflicts.length, "conflict") : this.clearText(nearer)}.`;
    const changed = this.compared(conflicts);
    if (!changed.gone && !changed.come && changed.all) return `${said}: the same ${counted(changed.all, "conflict")}.`;
    return `${said}: ${this.changeText(changed, this.clearText(nearer))}.`;
  }

  // "10 min later, 20 m higher".
  moveText() {
    const parts = [
      this.laterUs === 0 ? null : laterBy(this.laterUs), this.upM === 0 ? null : higherBy(this.upM).slice(2),
      this.waypoint === null ? null : `waypoint ${this.waypoint[0] + 1} elsewhere`,
    ].filter(Boolean);
    return parts.length ? parts.join(", ") : laterBy(0);
  }

  undoOf({ later_us: laterUs, up_m: upM, waypoint }) {
    return { later_us: -laterUs, up_m: -upM, waypoint: waypoint && [waypoint[0], ...this.whatIf.plan.geometry.coordinates[waypoint[0]]] };
  }

  takeStored(digest) {
    this.whatIf.digest = digest; // until it is read again
    this.reset();
  }

  // Moves the plan if it is known, and widens the range if need be.
  moveWithin(us, upM = 0) {
    if (this.more.hidden) return;
    this.upM = this.whatIf.mayRise ? Math.min(MOST_UP_M, Math.max(-MOST_UP_M, upM)) : 0;
    const wide = RANGES.find((s) => 1e6 * s >= Math.abs(us)) ?? RANGES[RANGES.length - 1];
    this.laterUs = Math.sign(us) * Math.min(Math.abs(us), 1e6 * wide);
    if (wide > this.rangeS) return this.widen(wide);
    this.moveTo(this.laterUs);
  }

  pressed(event) {
    const step = 1e6 * Math.max(1, this.rangeS / 240);
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    const to = by !== undefined ? this.laterUs + by * step : { Home: -1e6 * this.rangeS, End: 1e6 * this.rangeS }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.moveTo(seconds(Math.min(1e6 * this.rangeS, Math.max(-1e6 * this.rangeS, to))));
  }

  // Where the browser does not let the page copy, the text is there to be copied.
  async copy(what, textOf) {
    const text = textOf(this.whatIf.plan);
    try {
      await navigator.clipboard.writeText(text);
      this.copied.textContent = `Copied as ${what}: ${this.moveText()}.`;
    } catch {
      this.text.value = text;
      this.text.hidden = false;
      this.text.focus();
      this.text.select();
    }
  }
}
