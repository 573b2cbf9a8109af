// One object's brief for its captain or range officer, on one page: when and where it is, whom it meets, whom to call.

import { offsetAt } from "./display.js";
import { element } from "./dom.js";
import { clock, day, heights, period, place, printable, zone } from "./format.js";
import { missingText } from "./missing.js";
import { worstFirst } from "./model.js";
import { namesOf } from "./pair_names.js";

const MOST_POINTS = 100;
const MOST_CONFLICTS = 100;

// An instant in the zone that is shown, and in UTC if that is another time.
function both(t) {
  if (!Number.isFinite(t)) return "no limit";
  const there = `${day(t)} ${clock(t)} ${zone(t)}`;
  return offsetAt(t) === 0 ? there : `${there} (${new Date(1000 * Math.round(t)).toISOString().slice(11, 19)} UTC)`;
}

export class Brief {
  // `print()` prints the page.
  constructor(section, source, print) {
    Object.assign(this, { section, source, print });
    this.settled = null;
    this.shown = null; // { object, model }
  }

  get isShown() {
    return !this.section.hidden;
  }

  show(object, model) {
    this.section.hidden = false;
    document.documentElement.classList.add("briefed");
    this.take(object, model);
    this.section.querySelector("h2").focus({ preventScroll: true });
  }

  take(object, model) {
    this.shown = { object, model };
    this.settled = this.read();
  }

  // Of a scene that has changed, or is no longer shown.
  takeAgain(model) {
    if (!this.shown) return;
    const object = model.objects.get(this.shown.object.key);
    if (object) this.take(object, model);
    else this.hide();
  }

  hide() {
    this.section.hidden = true;
    this.section.replaceChildren();
    this.shown = null;
    document.documentElement.classList.remove("briefed");
  }

  // Reads who owns what, and writes it.
  async read() {
    const { object } = this.shown;
    this.owners = null;
    this.draw();
    try {
      const owners = await this.source.owners(object.key);
      if (this.shown?.object !== object) return;
      this.owners = owners;
    } catch {
      return; // the brief says nothing of owners
    }
    this.draw();
  }

  draw() {
    if (!this.shown) return;
    const { object, model } = this.shown;
    const conflicts = worstFirst(model.conflictsOf(object.key));
    const owner = this.owners?.[object.key];
    const hasFocus = this.section.contains(document.activeElement);
    this.section.replaceChildren(
      element("header", {}, element("h2", { tabindex: "-1" }, element("bdi", {}, printable(object.name || object.key))),
        element("button", { type: "button", click: this.print }, "Print the brief"),
        element("button", { type: "button", class: "plain", "aria-label": "Close the brief", click: () => this.hide() }, "✕")),
      element("dl", {},
        ...this.fact("Key", printable(object.key)), ...this.fact("Scene", printable(model.scene.scene)),
        ...this.fact("Heights", object.floors || object.ceilings ? "change on the way" : heights(object.floor, object.ceiling)),
        ...(owner ? this.fact("Owner", printable(owner)) : [])),
      element("h3", {}, "When"), this.times(object),
      element("h3", {}, conflicts.length ? `Conflicts, the worst first` : "No conflict"), this.conflicts(object, conflicts, model),
      ...(model.scene.is_current ? [] : [element("p", {}, `Not current: ${printable(model.scene.remark ?? "")}.`)]));
    if (hasFocus) this.section.querySelector("h2").focus({ preventScroll: true });
  }

  fact(name, value) {
    return [element("dt", {}, name), element("dd", {}, element("bdi", {}, value))];
  }

  times(object) {
    if (object.kind === "area") {
      const spans = object.spans ?? [[object.start ?? -Infinity, object.end ?? Infinity]];
      return element("ul", {}, ...spans.slice(0, MOST_POINTS).map(([from, to]) => element("li", {}, Number.isFinite(from) || Number.isFinite(to) ? `${both(from)} to ${both(to)}` : "always active")),
        spans.length > MOST_POINTS ? element("li", {}, `and ${spans.length - MOST_POINTS} more times`) : null);
    }
    const { points } = object.motion;
    return element("table", {}, element("thead", {}, element("tr", {}, ...["", "Place", "Time"].map((name) => element("th", { scope: "col" }, name)))),
      element("tbody", {}, ...points.slice(0, MOST_POINTS).map(({ lon, lat, t }, n) => element("tr", {},
        element("td", {}, String(n + 1)), element("td", {}, place(lon, lat)), element("td", {}, both(t))))));
  }

  conflicts(object, conflicts, model) {
    const rows = conflicts.slice(0, MOST_CONFLICTS).map((one) => {
      const other = one.a === object.key ? one.b : one.a;
      const name = namesOf(one, model.objects)[one.a === object.key ? 1 : 0];
      const facts = [
        one.verdict === "conflict" ? null : one.verdict, one.missing && missingText(one), one.lon === null ? null : `first at ${place(one.lon, one.lat)}`,
        one.acknowledged_by === null ? "not acknowledged" : `acknowledged by ${printable(one.acknowledged_by)}: ${printable(one.acknowledged_for)}`,
      ].filter(Boolean).join("; ");
      const call = this.owners?.[other];
      return element("li", {}, element("b", {}, element("bdi", {}, name)), call ? `, call ${printable(call)}` : "", element("br"),
        `${period(one.start, one.end, null)} ${zone(one.start)}${one.periods.length > 1 ? `, ${one.periods.length} periods` : ""}`, element("br"), facts);
    });
    return element("ol", {}, ...rows, conflicts.length > MOST_CONFLICTS ? element("li", {}, `and ${conflicts.length - MOST_CONFLICTS} more`) : null);
  }
}
