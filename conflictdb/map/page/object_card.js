// The selected object: what it is, how many conflicts it has, and what it comes nearest to if it has none.

import { element } from "./dom.js";
import { bound, clock, counted, distance, heights, leastDistance, period, printable } from "./format.js";
import { FARTHEST_M } from "./nearest.js";

export class ObjectCard {
  // `on`: whatIf(track), brief(object), close(), goTo(object)
  constructor(container, on) {
    Object.assign(this, { container, on });
    this.asked = 0;
  }

  hide() {
    this.asked += 1;
    this.container.hidden = true;
    this.container.replaceChildren();
  }

  // `approach()` brings the nearest approach (nearest.js), for an object without conflicts.
  async show(object, conflicts, { isCurrent, asksWhatIf, maySendAway }, approach) {
    const asked = ++this.asked;
    const said = element("p", { class: "said", role: "status" }, conflicts > 0 ? `${counted(conflicts, "conflict")}, in the list below.` : "No conflict. Looking for what comes nearest …");
    const height = object.floors || object.ceilings ? "heights that change" : heights(object.floor, object.ceiling);
    this.container.replaceChildren(
      element("header", {}, element("h2", {}, element("bdi", {}, printable(object.key))),
        element("button", { type: "button", class: "plain", "aria-label": "Deselect", click: this.on.close }, "✕")),
      element("p", { class: "soft" }, object.name ? element("bdi", {}, `${printable(object.name)}, `) : null,
        `${object.kind}, ${height}, ${period(object.start ?? -Infinity, object.end ?? Infinity, null)}`),
      said,
      element("div", { class: "copies" },
        element("button", { type: "button", class: "plain", click: () => this.on.goTo(object) }, "Show on the map"),
        element("button", { type: "button", class: "plain", click: () => this.on.brief(object) }, "Brief"),
        object.kind === "area" && asksWhatIf && maySendAway ? element("button", { type: "button", class: "plain", click: () => this.on.whatIf(object) }, "What if it moves?") : null,
        object.kind === "track" && asksWhatIf ? element("button", { type: "button", class: "plain", click: () => this.on.whatIf(object) }, "What if it departs at another time?") : null));
    this.container.hidden = false;
    if (conflicts > 0) return;
    const none = isCurrent ? "No conflict." : "No conflict is known yet.";
    let found;
    try {
      found = await approach();
    } catch (error) {
      found = undefined;
      if (asked === this.asked) said.textContent = `${none} What comes nearest is not known: ${printable(error.message)}.`;
    }
    if (asked !== this.asked || found === undefined) return;
    said.replaceChildren(...(found === null ? [`${none} Nothing comes within ${leastDistance(FARTHEST_M)} at its time and heights.`] : [
      `${none} Nearest at its heights: `, element("bdi", {}, printable(found.other)), `, ${distance(found.m)} (within ${bound(found.error, "m")})`,
      ...(Number.isFinite(found.t) ? [", at ", element("button", { type: "button", class: "link", click: () => this.on.goTo(object, found.t) }, `${clock(found.t)}`)] : []), "."]));
  }
}
