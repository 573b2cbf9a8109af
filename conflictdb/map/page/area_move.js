// What if an area were elsewhere, or active from or until another instant: the server says what it would meet.

import { element } from "./dom.js";
import { capital, counted, distance, moment, printable, zone } from "./format.js";
import { laterBy, PlanMove, RANGES, SECOND } from "./plan_move.js";
import { RADIANS, shorter, SPHERE_M } from "./world.js";

const ENDS = { starts: "start", ends: "end" }; // of an area

// By how much one place is east and north of another, degrees of latitude.
const between = ([lon, lat], [toLon, toLat]) => [shorter(toLon - lon) * Math.cos(((lat + toLat) / 2) * RADIANS), toLat - lat];

// Metres and degrees from north from one place to another, for words.
function wayBetween(from, to) {
  const [east, north] = between(from, to);
  return [Math.hypot(east, north) * RADIANS * SPHERE_M, ((Math.atan2(east, north) / RADIANS) + 360) % 360];
}

// The rings of a feature as they are drawn when a place of it goes to another one, degrees: as large, around that.
function shiftedRings({ geometry: { type, coordinates } }, shift) {
  const [lon, lat, toLon, toLat] = shift ?? [0, 0, 0, 0];
  const polygons = type === "Polygon" ? [coordinates] : coordinates;
  const there = ([x, y]) => {
    const [east, north] = between([lon, lat], [x, y]);
    return [toLon + east / Math.cos(Math.min(89, Math.abs(toLat + north / 2)) * RADIANS), toLat + north];
  };
  return polygons.flat().map((ring) => (shift ? ring.map(there) : ring));
}

export class AreaMove extends PlanMove {
  // `on`: as PlanMove, and change(plan) of a moved plan (null: as planned), plan(key), handle(place) shows a handle at a place (null: none).
  constructor(container, on) {
    super(container, on);
    this.rangeS = RANGES[1];
  }

  async open(area, scene, planned) {
    Object.assign(this, { scene, area, key: area.key, planned: new Set(planned), feature: null, digest: null });
    this.forget();
    this.summary = element("p", { class: "said", role: "status" }, "Reading …");
    this.range = this.rangeChoice(() => { this.rangeS = Number(this.range.value); this.limit(); });
    const slider = (name, label) => element("input", { type: "range", step: 60, "aria-label": label, input: (event) => this.moveEnd(name, Number(event.target.value)) });
    this.sliders = { starts: slider("starts", "Becomes active"), ends: slider("ends", "Ends") };
    this.texts = { starts: element("span", { class: "soft" }), ends: element("span", { class: "soft" }) };
    const hasTimes = !area.spans && (area.start !== null || area.end !== null);
    this.range.hidden = !hasTimes;
    this.times = element("div", { hidden: !hasTimes }, ...Object.keys(this.sliders).map((name) => element("div", { class: "end" }, this.texts[name], this.sliders[name])));
    this.makeWriting();
    this.fill("moves", "a", element("div", { class: "choices" }, this.range, this.marginChoice(() => this.rewrite())), this.summary, this.times,
      element("p", { class: "soft how" }, "Drag its handle on the map, or move it by the arrow keys."),
      element("div", { class: "stores" }, element("button", { type: "button", click: () => this.reset() }, "As planned")), this.writing, this.stored);
    await this.read();
  }

  forget() {
    Object.assign(this, { place: null, starts: 0, ends: 0 });
  }

  async read() {
    const asked = ++this.asked;
    try {
      const { feature, plan } = await this.on.plan(this.key);
      if (asked !== this.asked) return;
      if (plan !== this.digest) this.forget(); // of another plan
      Object.assign(this, { feature, digest: plan });
    } catch (error) {
      if (asked === this.asked) this.summary.textContent = `Not known: ${printable(error.message)}.`;
      return;
    }
    this.limit();
    this.draw();
  }

  // Of a scene that has changed.
  readAgain(area, planned) {
    Object.assign(this, { area, planned: new Set(planned) });
    return this.read();
  }

  limit() {
    for (const [name, slider] of Object.entries(this.sliders)) {
      [slider.min, slider.max] = [-this.rangeS, this.rangeS];
      slider.value = this[name];
      slider.disabled = this.area[ENDS[name]] === null;
    }
  }

  hideHandles() {
    this.on.handle(null);
  }

  movePlace(lon, lat) {
    this.place = [lon, lat];
    this.draw();
  }

  moveEnd(name, s) {
    this[name] = s;
    this.draw();
  }

  reset() {
    this.forget();
    this.limit();
    this.draw();
  }

  get shift() {
    return this.place && [...this.area.inside, ...this.place];
  }

  get what() {
    return { key: this.key, plan: this.digest, shift_deg: this.shift, starts_us: this.starts * SECOND, ends_us: this.ends * SECOND };
  }

  get isPlanned() {
    return this.place === null && this.starts === 0 && this.ends === 0;
  }

  get asksServer() {
    return this.isOpen && !(this.isPlanned && this.isSettled);
  }

  // Whether what the plan meets as it is planned is known.
  get isSettled() {
    return this.planned.size > 0 || !this.hasMargin;
  }

  // "4.2 nmi 270°, active from 07:20, until 08:10".
  moveText() {
    const way = this.place && wayBetween(this.area.inside, this.place);
    return [
      way && `${distance(way[0])} ${String(Math.round(way[1]) % 360).padStart(3, "0")}°`,
      this.starts && `active from ${this.endText("starts")}`, this.ends && `until ${this.endText("ends")}`,
    ].filter(Boolean).join(", ") || "as planned";
  }

  endText(name) {
    const t = this.area[ENDS[name]];
    return t === null ? "no limit" : `${moment(t + this[name])} ${zone(t)}`;
  }

  // In other units, another zone, or with another margin.
  rewrite() {
    if (!this.isOpen || !this.feature) return;
    this.offerMargins();
    this.draw();
  }

  draw() {
    this.on.handle(this.place ?? this.area.inside);
    for (const [name, slider] of Object.entries(this.sliders)) {
      const by = this[name] === 0 ? "" : ` (${laterBy(this[name] * SECOND)})`;
      this.texts[name].textContent = `${{ starts: "Active from", ends: "until" }[name]} ${this.endText(name)}${by}`;
      slider.setAttribute("aria-valuetext", `${this.endText(name)}${by}`);
    }
    this.offerWriting(!this.isPlanned);
    if (this.isPlanned) this.on.change(null);
    if (this.asksServer) this.probe();
    else this.summary.textContent = `As planned: ${this.planned.size ? counted(this.planned.size, "conflict") : this.clearText()}.`;
  }

  // Shows the conflicts of the area as it is moved.
  show(conflicts, nearer) {
    const clear = this.clearText(nearer);
    if (this.isPlanned) {
      this.summary.textContent = `As planned: ${conflicts.length ? counted(conflicts.length, "conflict") : clear}.`;
      return;
    }
    this.summary.textContent = `${capital(this.moveText())}: ${this.changeText(this.compared(conflicts), clear)}.`;
    this.on.change({ key: this.key, laterUs: 0, upM: 0, waypoint: null, conflicts, rings: shiftedRings(this.feature, this.shift) });
  }

  undoOf({ shift_deg: shift, starts_us: startsUs, ends_us: endsUs }) {
    return { shift_deg: shift && [...shift.slice(2), ...shift.slice(0, 2)], starts_us: -startsUs, ends_us: -endsUs };
  }

  takeStored(digest) {
    this.digest = digest; // until it is read again
    this.forget();
    this.limit();
    this.on.change(null);
  }
}
