// The list of conflicts, the worst first. Only rows in view are elements: there may be tens of thousands.

import { byId, element } from "./dom.js";
import { bound, clock, depth, duration, grouped, moment, printable } from "./format.js";

const ROW = 60; // height of a row, pixels, as style.css has it
const MORE = 6; // rows beyond the view, above and below
const MOST_KEYS = 24; // characters of both keys that have room in a row
const MOST_PRINTED = 500; // rows
const TOLD_S = 0.1; // an error of times that is smaller is told of one conflict, not in the list

export class List {
  constructor(container, onChoose) {
    this.container = container;
    this.rows = container.querySelector("ul");
    this.empty = container.querySelector("p");
    this.order = document.getElementById("order");
    this.onChoose = onChoose;
    this.conflicts = [];
    this.objects = new Map();
    this.shown = new Map();
    this.chosen = null;
    this.t = 0;
    this.order = byId("order");
    this.separationM = 0;
    this.isPrinted = false;
    container.addEventListener("scroll", () => this.render(), { passive: true });
    new ResizeObserver(() => this.render()).observe(container);
    this.rows.addEventListener("keydown", (event) => {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (by) {
        event.preventDefault();
        this.focus(Number(event.target.closest("li")?.dataset.n ?? -1) + by);
      }
    });
  }

  // Shows conflicts of a scene; without any conflict it says why there is none.
  take(conflicts, { objects, scene }, why) {
    this.objects = objects;
    this.separationM = scene.separation_m;
    this.order.hidden = !conflicts.some(({ depth }) => depth !== null);
    this.empty.hidden = conflicts.length > 0;
    this.empty.textContent = why;
    const focused = this.rows.contains(document.activeElement) ? Number(document.activeElement.closest("li").dataset.n) : -1;
    this.conflicts = conflicts;
    const dayOf = ({ start }) => Math.floor(start / 86400);
    const dated = conflicts.filter(({ start }) => Number.isFinite(start));
    this.several = dated.some((c) => dayOf(c) !== dayOf(dated[0]));
    this.rows.classList.toggle("dated", this.several); // a date is long: names have the first line
    this.rows.replaceChildren();
    this.shown.clear();
    this.rows.style.height = `${conflicts.length * ROW}px`;
    this.render();
    if (focused >= 0) this.focus(Math.min(focused, conflicts.length - 1));
  }

  show(t, chosen) {
    this.t = t;
    this.chosen = chosen;
    for (const [n, row] of this.shown) this.mark(row, this.conflicts[n]);
  }

  reveal(id) {
    const n = this.conflicts.findIndex((c) => c.id === id);
    const { scrollTop, clientHeight } = this.container;
    if (n >= 0 && (n * ROW < scrollTop || (n + 1) * ROW > scrollTop + clientHeight)) {
      this.container.scrollTop = Math.max(0, n * ROW - clientHeight / 3);
    }
    this.render(); // also where the list was hidden until now
    return n;
  }

  focus(n) {
    if (n < 0 || n >= this.conflicts.length) return;
    this.reveal(this.conflicts[n].id);
    this.shown.get(n)?.querySelector("button").focus();
  }

  // Has all rows there, or as many as paper takes, while they are printed.
  print(isPrinted) {
    this.isPrinted = isPrinted;
    this.render();
    if (this.conflicts.length === 0) return;
    const left = this.conflicts.length - MOST_PRINTED;
    this.empty.hidden = !isPrinted || left <= 0;
    this.empty.textContent = left > 0 ? `and ${grouped(left)} more` : "";
  }

  // The rows that are wanted, from the first to before the last.
  wanted() {
    if (this.isPrinted) return [0, Math.min(this.conflicts.length, MOST_PRINTED)];
    const { scrollTop, clientHeight } = this.container;
    return [Math.max(0, Math.floor(scrollTop / ROW) - MORE), Math.min(this.conflicts.length, Math.ceil((scrollTop + clientHeight) / ROW) + MORE)];
  }

  render() {
    const [first, last] = this.wanted();
    for (const [n, row] of this.shown) {
      if (n < first || n >= last) {
        row.remove();
        this.shown.delete(n);
      }
    }
    for (let n = first; n < last; n += 1) {
      if (!this.shown.has(n)) {
        const row = this.row(n);
        // In their order, which is that of the keyboard.
        const after = [...this.rows.children].find((other) => Number(other.dataset.n) > n) ?? null;
        this.rows.insertBefore(row, after);
        this.shown.set(n, row);
      }
    }
  }

  row(n) {
    const conflict = this.conflicts[n];
    const lasts = conflict.periods.reduce((sum, [a, b]) => sum + (b - a), 0);
    const facts = [
      conflict.verdict === "conflict" ? null : conflict.verdict,
      conflict.depth === null ? null : depth(conflict.depth, this.separationM),
      Number.isFinite(lasts) ? duration(lasts) : "without end",
      conflict.error_s !== null && conflict.error_s < TOLD_S ? null : `± ${bound(conflict.error_s, "s")}`,
      conflict.periods.length > 1 ? `${conflict.periods.length} periods` : null,
      this.names(conflict),
    ].filter(Boolean).join(" · ");
    const when = conflict.start === -Infinity ? "since ever"
      : this.several ? `${moment(conflict.start).replace(/ \d{4} /, " ")}` : clock(conflict.start);
    const change = conflict.since ?? conflict.change;
    const [a, b] = [printable(conflict.a), printable(conflict.b)];
    const isCut = a.length + b.length > MOST_KEYS; // the longer one, as far as it takes half of the room
    const row = element("li", { "data-n": n, "aria-setsize": this.conflicts.length, "aria-posinset": n + 1 },
      element("button", { type: "button", class: "row", click: () => this.onChoose(conflict) },
        element("span", { class: `mark ${conflict.verdict}`, "aria-hidden": "true" }),
        element("span", { class: "keys" },
          element("bdi", { class: isCut && a.length >= b.length ? "longer" : null }, a), element("span", { class: "soft" }, " and "),
          element("bdi", { class: isCut && b.length > a.length ? "longer" : null }, b)),
        element("span", { class: "when" }, when),
        element("span", { class: "facts" }, facts),
        element("span", { class: "tags" },
          conflict.isBeyond ? element("span", { class: "tag" }, "near the pole") : null,
          change ? element("span", { class: `tag ${change}` }, change) : null,
          conflict.is_current ? null : element("span", { class: "tag" }, "changed since"),
          conflict.acknowledged_by === null ? null : element("span", { class: "tag" }, "acknowledged"))));
    row.style.transform = `translateY(${n * ROW}px)`;
    this.mark(row, conflict);
    return row;
  }

  // The names of both objects, of those that have one that is not their key.
  names({ a, b }) {
    const names = [a, b].map((key) => [key, this.objects.get(key)?.name]).filter(([key, name]) => name && name !== key);
    return names.map(([, name]) => printable(name)).join(" and ");
  }

  mark(row, conflict) {
    row.classList.toggle("gone", conflict.change === "gone");
    const isOn = conflict.change !== "gone" && conflict.periods.some(([a, b]) => this.t >= a && this.t <= b);
    row.classList.toggle("on", isOn);
    const button = row.firstElementChild;
    if (this.chosen === conflict.id) button.setAttribute("aria-current", "true");
    else button.removeAttribute("aria-current");
  }
}
