// What the page shows, in its address after the #, so that Back, reload and a copied link show it again.

import { display, isZone } from "./display.js";
import { instantOf } from "./format.js";
import { LAYERS } from "./heights.js";
import { VERDICTS } from "./model.js";

const REST_MS = 400; // after the last change it is written: browsers limit how often

// Fields have instants in the zone that is shown, addresses in UTC.
const inUtc = (text) => { const t = instantOf(text); return t === null ? null : utc(t); };
const utc = (t) => new Date(Math.round(t) * 1000).toISOString().slice(0, 19).replace("T", " ");
const finite = (text) => (text !== null && text.trim() !== "" && Number.isFinite(Number(text)) ? Number(text) : null);

// Texts of what is shown: absent where it is as at first.
export function addressOf({ scene, t, view, chosen, selected, filter, departure, side, rows, table }) {
  const given = {
    scene, t: Number.isFinite(t) ? utc(t) : null,
    view: view?.join(","), a: chosen?.a, b: chosen?.b, object: filter.object || null,
    verdicts: filter.verdicts.length < VERDICTS.length ? filter.verdicts.join(",") : null,
    from: inUtc(filter.from), to: inUtc(filter.to), floor: filter.floor || null, ceiling: filter.ceiling || null,
    now: filter.now ? "1" : null, open: filter.open ? "1" : null, departs: departure?.key, higher: departure?.upM ? String(departure.upM) : null,
    layers: filter.layers.length < LAYERS.length ? filter.layers.join(",") : null, side, rows: rows === "object" ? rows : null, table: table ? "1" : null, selected: chosen ? null : selected,
    later: departure?.laterUs ? String(departure.laterUs / 1e6) : null, units: display.isNautical ? null : "metric", zone: display.zone === "UTC" ? null : display.zone,
  };
  const known = Object.entries(given).filter(([, value]) => value !== null && value !== undefined);
  return `#${new URLSearchParams(known)}`;
}

// The address of a scene, as it opens.
export const addressOfScene = (scene) => `#${new URLSearchParams({ scene })}`;

// What an address asks for; whatever is not understood is as at first.
export function askedBy(hash) {
  const asked = new URLSearchParams(hash.replace(/^#/, ""));
  const text = (name) => asked.get(name) ?? "";
  const verdicts = asked.has("verdicts") ? text("verdicts").split(",").filter((one) => VERDICTS.includes(one)) : VERDICTS;
  const layers = asked.has("layers") ? text("layers").split(",").filter((one) => LAYERS.includes(one)) : LAYERS;
  const view = text("view").split(",").map(finite);
  const isPlace = view.length === 3 && !view.includes(null) && Math.abs(view[1]) <= 90;
  const number = (name) => (finite(text(name)) === null ? "" : text(name));
  const instant = (name) => { const t = instantOf(text(name), true); return t === null ? "" : t; };
  return {
    scene: asked.get("scene"), display: { isNautical: text("units") !== "metric", zone: isZone(text("zone") || "UTC") ? text("zone") || "UTC" : "UTC" }, t: instantOf(text("t"), true), view: isPlace ? view : null,
    pair: asked.has("a") && asked.has("b") ? [text("a"), text("b")] : null,
    side: ["time", "track"].includes(text("side")) ? text("side") : null, selected: asked.get("selected"), table: text("table") === "1", rows: text("rows") === "object" ? "object" : "conflict",
    filter: {
      layers: layers.length ? layers : LAYERS, object: text("object").slice(0, 1000), verdicts, from: instant("from"), to: instant("to"), floor: number("floor"), ceiling: number("ceiling"),
      now: text("now") === "1", open: text("open") === "1",
    },
    departure: asked.has("departs") ? { key: text("departs"), laterS: finite(text("later")) ?? 0, upM: finite(text("higher")) ?? 0 } : null,
  };
}

export class Address {
  // `read()` returns what is shown, as addressOf takes it; `show(asked)` shows what an address asks for.
  constructor(read, show) {
    this.read = read;
    this.show = show;
    this.timer = null;
    this.isStill = true; // while nothing is written
  }

  // Shows what the address asks for, and keeps it true from now on.
  async begin() {
    if (location.hash.length > 1) await this.show(askedBy(location.hash));
    this.isStill = false;
    this.soon();
    window.addEventListener("popstate", () => this.shown());
  }

  async shown() {
    this.isStill = true;
    clearTimeout(this.timer);
    try {
      await this.show(askedBy(location.hash));
    } finally {
      this.isStill = false;
    }
  }

  // Writes what is shown when it rests.
  soon() {
    clearTimeout(this.timer);
    if (!this.isStill) this.timer = setTimeout(() => this.write(false), REST_MS);
  }

  // Writes what waits to be written, before a step.
  flush() {
    if (this.timer === null) return;
    clearTimeout(this.timer);
    if (!this.isStill) this.write(false);
  }

  // Writes it as a step that Back takes back.
  step() {
    clearTimeout(this.timer);
    if (!this.isStill) this.write(true);
  }

  write(isStep) {
    this.timer = null;
    const hash = addressOf(this.read());
    if (hash === location.hash) return;
    if (isStep) history.pushState(null, "", hash);
    else history.replaceState(null, "", hash);
  }
}
