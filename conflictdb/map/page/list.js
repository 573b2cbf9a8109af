// The list of conflicts, the worst first. Only rows in view are elements: there may be tens of thousands.

import { byId, element } from "./dom.js";
import { bound, clock, day, duration, grouped, moment, period, printable } from "./format.js";
import { areNamed, fittedPair, namesOf } from "./pair_names.js";
import { missingText } from "./missing.js";
import { lasting } from "./model.js";
import { font } from "./theme.js";

const ROW_PX = 60; // height of a row; one more line each for names one below the other, and for tags
const LINE_PX = 20;
const MORE = 10; // rows beyond the view, above and below
const MOST_KEYS = 24; // characters of both keys that have room in one line
const [LEFT_PX, WHEN_PX] = [56, 84]; // beside names: their mark, and the time
const WHEN_BESIDE = matchMedia("(min-width: 901px), (max-width: 640px)"); // as style.css has it
const MOST_PRINTED = 500; // rows
const TOLD_S = 0.1; // an error of times that is smaller is told of one conflict, not in the list

const yearOf = ({ start }) => day(start).slice(-4);

// What a row says beside its facts: [text, kind].
function tagsOf({ isBeyond, since, change, is_current: isCurrent, acknowledged_by: by }) {
  const what = since ?? change;
  return [isBeyond ? ["near the pole"] : null, what ? [what, what] : null, isCurrent ? null : ["changed since"], by === null ? null : ["acknowledged"]].filter(Boolean);
}

export class List {
  constructor(container, onChoose) {
    this.container = container;
    this.rows = container.querySelector("ul");
    this.empty = container.querySelector("p");
    this.onChoose = onChoose;
    this.conflicts = [];
    this.objects = new Map();
    this.shown = new Map();
    this.chosen = null;
    this.t = 0;
    this.order = byId("order");
    this.height = ROW_PX;
    this.pen = document.createElement("canvas").getContext("2d"); // measures
    this.isPrinted = false;
    container.addEventListener("scroll", () => this.render(), { passive: true });
    new ResizeObserver(() => this.resized()).observe(container);
    this.rows.addEventListener("keydown", (event) => {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (by) {
        event.preventDefault();
        this.focus(Number(event.target.closest("li")?.dataset.n ?? -1) + by);
      }
    });
  }

  // Shows conflicts of a scene; without any conflict it says why there is none.
  take(conflicts, { objects, isRanked }, why) {
    this.objects = objects;
    this.order.hidden = !isRanked || conflicts.length === 0;
    this.empty.hidden = conflicts.length > 0;
    this.empty.textContent = why;
    const focused = this.rows.contains(document.activeElement) ? Number(document.activeElement.closest("li").dataset.n) : -1;
    this.conflicts = conflicts;
    const dayOf = ({ start }) => day(start);
    const dated = conflicts.filter(({ start }) => Number.isFinite(start));
    this.several = dated.some((c) => dayOf(c) !== dayOf(dated[0]));
    this.isOneYear = dated.every((c) => yearOf(c) === yearOf(dated[0]));
    this.rows.classList.toggle("dated", this.several); // a date is long: names have the first line
    this.isTall = conflicts.some((one) => areNamed(one, objects) || one.a.length + one.b.length > MOST_KEYS);
    this.lay();
    if (focused >= 0) this.focus(Math.min(focused, conflicts.length - 1));
  }

  // Names are cut to the width; a list that is hidden has none.
  resized() {
    const { clientWidth } = this.container;
    if (clientWidth === 0 || clientWidth === this.width) {
      this.render();
      return;
    }
    const focused = this.rows.contains(document.activeElement) ? Number(document.activeElement.closest("li").dataset.n) : -1;
    this.lay();
    if (focused >= 0) this.shown.get(focused)?.querySelector("button").focus({ preventScroll: true });
  }

  // Makes all rows anew.
  lay() {
    this.width = this.container.clientWidth || this.width || LEFT_PX + WHEN_PX;
    this.isBeside = !this.several && WHEN_BESIDE.matches; // the time beside the names
    const isTagged = !this.isBeside && this.conflicts.some((one) => tagsOf(one).length > 0);
    this.height = ROW_PX + LINE_PX * (this.isTall + isTagged);
    this.rows.classList.toggle("tall", this.isTall);
    this.rows.style.setProperty("--row", `${this.height}px`);
    this.rows.replaceChildren();
    this.shown.clear();
    this.rows.style.height = `${this.conflicts.length * this.height}px`;
    this.render();
  }

  show(t, chosen) {
    this.t = t;
    this.chosen = chosen;
    for (const [n, row] of this.shown) this.mark(row, this.conflicts[n]);
  }

  reveal(id) {
    const n = this.conflicts.findIndex((c) => c.id === id);
    const { scrollTop, clientHeight } = this.container;
    const { height } = this;
    if (n >= 0 && (n * height < scrollTop || (n + 1) * height > scrollTop + clientHeight)) {
      this.container.scrollTop = Math.max(0, n * height - clientHeight / 3);
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
    return [Math.max(0, Math.floor(scrollTop / this.height) - MORE), Math.min(this.conflicts.length, Math.ceil((scrollTop + clientHeight) / this.height) + MORE)];
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
    const lasts = lasting(conflict);
    const facts = [
      this.before(conflict),
      conflict.verdict === "conflict" ? null : conflict.verdict,
      conflict.missing && missingText(conflict),
      Number.isFinite(lasts) ? duration(lasts) : "without end",
      conflict.error_s !== null && conflict.error_s < TOLD_S ? null : `± ${bound(conflict.error_s, "s")}`,
      conflict.periods.length > 1 ? `${conflict.periods.length} periods` : null,
    ].filter(Boolean);
    const when = conflict.start === -Infinity ? "since ever"
      : !this.several ? clock(conflict.start) : this.isOneYear ? moment(conflict.start).replace(/ \d{4} /, " ") : moment(conflict.start);
    const isNamed = areNamed(conflict, this.objects);
    const row = element("li", { "data-n": n, "aria-setsize": this.conflicts.length, "aria-posinset": n + 1 },
      element("button", { type: "button", class: "row", click: () => this.onChoose(conflict) },
        element("span", { class: `mark ${conflict.verdict}`, "aria-hidden": "true" }),
        element("span", { class: isNamed ? "names" : "names keys" }, ...this.lines(conflict)),
        element("span", { class: "when" }, when),
        element("span", { class: "facts", title: facts.join(" · ") }, ...facts.map((fact, nth) => element("span", {}, nth > 0 ? " · " : null, fact)),
          isNamed ? element("span", {}, " · ", element("span", { class: "keys" }, element("bdi", {}, printable(conflict.a)), " and ", element("bdi", {}, printable(conflict.b)))) : null),
        element("span", { class: "tags" }, ...tagsOf(conflict).map(([text, kind]) => element("span", { class: `tag ${kind ?? ""}` }, text)))));
    row.style.transform = `translateY(${n * this.height}px)`;
    this.mark(row, conflict);
    return row;
  }

  // Both names, one below the other if one line has no room for some of the list.
  lines(conflict) {
    const names = namesOf(conflict, this.objects);
    this.pen.font = font("text", 600);
    const room = this.width - LEFT_PX;
    const own = room - (this.isBeside ? WHEN_PX : 0);
    const shown = this.isTall ? fittedPair((text) => this.pen.measureText(text).width, names, [own, own]) : names;
    const line = (n) => element("bdi", { title: shown[n] === names[n] ? null : names[n] }, shown[n]);
    return [line(0), element("span", { class: this.isTall ? "unseen" : "soft" }, " and "), line(1)];
  }

  // The new and the old times of a conflict that is at another time.
  before({ was, start, end }) {
    return was ? `${period(start, end, start)}, was ${period(was.start, was.end, start)}` : null;
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
