// What if an area were elsewhere, or active from or until another instant: the server says what it would meet.

import { laterBy, probed } from "./departure.js";
import { element } from "./dom.js";
import { counted, distance, moment, printable, zone } from "./format.js";
import { RADIANS, shorter, SPHERE_M } from "./world.js";

const RANGES = [900, 3600, 10800, 43200, 86400]; // seconds to choose from
const SECOND = 1e6;

// Metres and degrees from north from one place to another, for words.
function wayBetween([lon, lat], [toLon, toLat]) {
  const east = shorter(toLon - lon) * Math.cos(((lat + toLat) / 2) * RADIANS);
  const north = toLat - lat;
  return [Math.hypot(east, north) * RADIANS * SPHERE_M, ((Math.atan2(east, north) / RADIANS) + 360) % 360];
}

// The rings of a feature as they are drawn when a place of it goes to another one, degrees: as far, on the same bearing.
export function shiftedRings({ geometry: { type, coordinates } }, shift) {
  const [lon, lat, toLon, toLat] = shift ?? [0, 0, 0, 0];
  const [east, north] = [shorter(toLon - lon) * Math.cos(((lat + toLat) / 2) * RADIANS), toLat - lat];
  const polygons = type === "Polygon" ? [coordinates] : coordinates;
  return polygons.flat().map((ring) => ring.map(([x, y]) => [x + east / Math.cos(Math.min(89, Math.abs(y + north / 2)) * RADIANS), y + north]));
}

export class AreaMove {
  // `on`: change(plan) of a moved plan (null: as planned), close(), rights() of the scene, move(what), probe(what), plan(key),
  // handle(place) shows a handle at a place (null: none), openScene(name).
  constructor(container, on) {
    Object.assign(this, { container, on });
    this.key = null;
    this.rangeS = RANGES[1];
    this.asked = 0;
  }

  get isOpen() {
    return this.key !== null;
  }

  async open(area, scene, planned) {
    const { container } = this;
    Object.assign(this, { scene, area, key: area.key, planned: new Set(planned) });
    this.forget();
    this.summary = element("p", { class: "said", role: "status" }, "Reading …");
    this.range = element("select", { "aria-label": "Range", change: () => { this.rangeS = Number(this.range.value); this.limit(); } },
      ...RANGES.map((s) => new Option(`± ${laterBy(s * SECOND).replace(" later", "")}`, s, s === this.rangeS, s === this.rangeS)));
    const slider = (name, label) => element("input", { type: "range", step: 60, "aria-label": label, input: (event) => this.moveEnd(name, Number(event.target.value)) });
    this.sliders = { starts: slider("starts", "Becomes active"), ends: slider("ends", "Ends") };
    this.told = { starts: element("span", { class: "soft" }), ends: element("span", { class: "soft" }) };
    const hasTimes = !area.spans && (area.start !== null || area.end !== null);
    this.times = element("div", { hidden: !hasTimes }, this.range, ...Object.keys(this.sliders).map((name) => element("div", { class: "end" }, this.told[name], this.sliders[name])));
    this.stored = element("p", { role: "status" });
    this.writing = element("div", { class: "stores", hidden: true },
      element("button", { type: "button", click: () => this.propose() }, "Propose"),
      element("button", { type: "button", click: () => this.apply() }, "Apply"));
    container.replaceChildren(
      element("header", {}, element("h2", { tabindex: "-1" }, "What if ", element("bdi", { class: "key-a" }, printable(area.key)), " moves"),
        element("button", { type: "button", class: "plain", "aria-label": "Close", click: () => this.close() }, "✕")),
      this.summary, this.times,
      element("p", { class: "soft" }, "Drag its handle on the map, or move it by the arrow keys."),
      element("div", { class: "stores" }, element("button", { type: "button", click: () => this.reset() }, "As planned")), this.writing, this.stored);
    container.hidden = false;
    container.querySelector("h2").focus({ preventScroll: true });
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
    this.show();
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
      slider.disabled = this.area[{ starts: "start", ends: "end" }[name]] === null;
    }
  }

  close() {
    if (!this.isOpen) return;
    this.key = null;
    this.digest = null;
    this.asked += 1;
    this.on.handle(null);
    this.container.hidden = true;
    this.container.replaceChildren();
    this.on.close();
  }

  movePlace(lon, lat) {
    this.place = [lon, lat];
    this.show();
  }

  moveEnd(name, s) {
    this[name] = s;
    this.show();
  }

  reset() {
    this.forget();
    this.limit();
    this.show();
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

  // "4.2 nmi 270°, active from 07:20, until 08:10".
  moveText() {
    const way = this.place && wayBetween(this.area.inside, this.place);
    return [
      way && `${distance(way[0])} ${String(Math.round(way[1]) % 360).padStart(3, "0")}°`,
      this.starts && `active from ${this.endText("starts")}`, this.ends && `until ${this.endText("ends")}`,
    ].filter(Boolean).join(", ") || "as planned";
  }

  endText(name) {
    const t = this.area[{ starts: "start", ends: "end" }[name]];
    return t === null ? "no limit" : `${moment(t + this[name])} ${zone(t)}`;
  }

  show() {
    this.on.handle(this.place ?? this.area.inside);
    for (const [name, slider] of Object.entries(this.sliders)) {
      const by = this[name] === 0 ? "" : ` (${laterBy(this[name] * SECOND)})`;
      this.told[name].textContent = `${{ starts: "Active from", ends: "until" }[name]} ${this.endText(name)}${by}`;
      slider.setAttribute("aria-valuetext", `${this.endText(name)}${by}`);
    }
    const { may_edit: mayEdit, branch_of: parent } = this.on.rights();
    this.writing.hidden = !mayEdit || this.isPlanned;
    this.writing.firstChild.hidden = parent !== null; // a branch has no branches
    if (this.isPlanned) {
      this.summary.textContent = `As planned: ${this.planned.size ? counted(this.planned.size, "conflict") : "clear"}.`;
      this.on.change(null);
    } else {
      this.probe();
    }
  }

  // Asks the server: one question at a time, the last one again.
  async probe() {
    this.isOutdated = true;
    if (this.isProbing) return;
    this.isProbing = true;
    const { asked, key } = this;
    const isHere = () => this.asked === asked && this.key === key && !this.isPlanned;
    try {
      while (this.isOutdated && isHere()) {
        this.isOutdated = false;
        const found = (await this.on.probe(this.what)).map(probed);
        if (!isHere()) break;
        this.tell(found);
        this.on.change({ key, laterUs: 0, upM: 0, waypoint: null, conflicts: found, rings: shiftedRings(this.feature, this.shift) });
      }
    } catch (error) {
      if (isHere()) this.summary.textContent = `Not known: ${printable(error.message)}.`;
    } finally {
      this.isProbing = false;
      if (this.isOutdated && this.isOpen && !this.isPlanned) this.probe();
    }
  }

  tell(conflicts) {
    const now = new Set(conflicts.map(({ other }) => other));
    const gone = [...this.planned].filter((key) => !now.has(key)).length;
    const come = [...now].filter((key) => !this.planned.has(key)).length;
    const said = this.moveText();
    this.summary.textContent = `${said.charAt(0).toUpperCase()}${said.slice(1)}: ${gone ? `${gone} fewer` : "none fewer"}, ${come ? `${come} new` : "none new"}${now.size ? `; ${now.size} in all` : "; clear, margin not known"}.`;
  }

  async propose() {
    const branch = `${this.scene}: ${this.key} ${this.moveText()}`;
    if (await this.store({ ...this.what, branch }) === null) return;
    this.stored.replaceChildren("Proposed as the branch ", element("bdi", {}, printable(branch)), ". ",
      element("button", { type: "button", class: "link", click: () => this.on.openScene(branch) }, "Open"));
  }

  // Stores it in the scene, which is then as planned.
  async apply(what = this.what, isUndo = false) {
    const { key } = this;
    const said = this.moveText();
    const undo = { shift_deg: what.shift_deg && [...what.shift_deg.slice(2), ...what.shift_deg.slice(0, 2)], starts_us: -what.starts_us, ends_us: -what.ends_us };
    const plan = await this.store({ ...what, branch: null });
    if (plan === null || this.key !== key) return;
    this.digest = plan; // until it is read again
    this.forget();
    this.limit();
    this.on.change(null);
    if (isUndo) this.stored.replaceChildren("Undone.");
    else this.stored.replaceChildren(`Applied: ${said}. `, element("button", { type: "button", class: "link", click: () => this.apply({ key, plan: this.digest, ...undo }, true) }, "Undo"));
  }

  // Returns the digest of what is stored; null if it is refused, which the page says.
  async store(what) {
    this.stored.textContent = "Storing …";
    try {
      return await this.on.move(what);
    } catch (error) {
      this.stored.textContent = `Not stored: ${printable(error.message)}.`;
      return null;
    }
  }
}
