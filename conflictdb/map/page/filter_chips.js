// What the filter leaves, as chips that take one limit away each.

import { element } from "./dom.js";
import { moment, printable } from "./format.js";
import { LAYERS } from "./heights.js";
import { VERDICTS } from "./model.js";

// The limits of a filter: [{ text, field }], a field by the name that `clear` takes.
export function limitsOf(filter) {
  const isSet = (value) => Number.isFinite(value);
  return [
    filter.text.trim() ? { text: `“${printable(filter.text.trim())}”`, field: "words" } : null,
    filter.verdicts.size < VERDICTS.length ? { text: [...filter.verdicts].join(", ") || "no verdict", field: "verdicts" } : null,
    isSet(filter.from) ? { text: `from ${moment(filter.from)}`, field: "from" } : null,
    isSet(filter.to) ? { text: `to ${moment(filter.to)}`, field: "to" } : null,
    isSet(filter.floor) ? { text: `above ${filter.floor} m`, field: "floor" } : null,
    isSet(filter.ceiling) ? { text: `below ${filter.ceiling} m`, field: "ceiling" } : null,
    filter.layers.size < LAYERS.length ? { text: [...filter.layers].join(", "), field: "layers" } : null,
    filter.now ? { text: "at the time shown", field: "now" } : null,
    filter.open ? { text: "not acknowledged", field: "open" } : null,
  ].filter(Boolean);
}

export class FilterChips {
  // `clear(field)` takes a limit away.
  constructor(container, clear) {
    Object.assign(this, { container, clear });
    this.shown = "";
  }

  take(filter) {
    const limits = limitsOf(filter);
    const shown = JSON.stringify(limits);
    if (shown === this.shown) return;
    this.shown = shown;
    const focused = [...this.container.children].indexOf(document.activeElement);
    this.container.hidden = limits.length === 0;
    this.container.replaceChildren(...limits.map(({ text, field }) => element("button", {
      type: "button", class: "chip set", "aria-label": `Remove the filter ${text}`, click: () => this.clear(field),
    }, element("bdi", {}, text), " ✕")));
    if (focused >= 0) this.container.children[Math.min(focused, limits.length - 1)]?.focus();
  }
}
