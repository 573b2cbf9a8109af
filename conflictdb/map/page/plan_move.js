// What moving a track and moving an area share: the server says what the plan would meet, and stores it.

import { element } from "./dom.js";
import { display } from "./display.js";
import { duration, givenDistance, NMI_M, printable } from "./format.js";

export const RANGES = [900, 3600, 10800, 43200, 86400]; // seconds to choose from
export const SECOND = 1e6;
// Margins to choose from, seconds, and metres by whether units are nautical.
const MARGINS_S = [60, 300, 600, 1800];
const MARGINS_M = { true: [0.1, 0.5, 1, 5].map((n) => n * NMI_M), false: [100, 500, 1000, 5000] };
export const LONGEST_MARGIN_S = MARGINS_S.at(-1);

// "1 h 4 min 10 s later", of microseconds, to the last one: a departure that is read out is the very same.
export function laterBy(us) {
  if (us === 0) return "as planned";
  const by = Math.abs(us);
  const parts = [[Math.floor(by / 3600e6), "h"], [Math.floor(by / 60e6) % 60, "min"], [(by % 60e6) / 1e6, "s"]];
  const said = parts.filter(([n]) => n > 0).map(([n, unit]) => `${Number(n.toFixed(6))} ${unit}`);
  return `${said.join(" ")} ${us > 0 ? "later" : "earlier"}`;
}

const marginText = ({ s, m }) => (m ? givenDistance(m) : `${s / 60} min`);

// A conflict as a probe returns it.
const probed = ([other, verdict, error, periods]) => (
  { other, verdict, error_s: error, periods: periods.map(([start, end]) => [start ?? -Infinity, end ?? Infinity]) });

// Subclasses have: `what` the server is asked, `moveText()`, `asksServer` whether to ask it what the plan would meet,
// `show(conflicts, nearer)` with the keys of what is within the margin of a plan without conflicts, `undoOf(what)`, `takeStored(digest)` of the plan that is stored, and `hideHandles()`.
export class PlanMove {
  // `on`: rights() of the scene, move(what) stores a plan, probe(what) returns its conflicts, openScene(name), close().
  constructor(container, on) {
    Object.assign(this, { container, on });
    this.key = null;
    this.asked = 0; // which answer is awaited
    this.margin = { s: 0, m: 0 }; // that proposed plans keep
  }

  get isOpen() {
    return this.key !== null;
  }

  rangeChoice(onChange) {
    return element("select", { "aria-label": "Range", change: onChange },
      ...RANGES.map((s) => new Option(`± ${duration(s).replace(/ 00 (s|min)/, "")}`, s, s === this.rangeS, s === this.rangeS)));
  }

  marginChoice(onChange) {
    this.margins = element("select", { "aria-label": "Margin", change: () => { this.margin = JSON.parse(this.margins.value); onChange(); } });
    this.offerMargins();
    return this.margins;
  }

  // In the units that are shown, and the one that is chosen.
  offerMargins() {
    const { s: chosenS, m: chosenM } = this.margin;
    const metres = [...new Set([...MARGINS_M[display.isNautical], ...(chosenM ? [chosenM] : [])])];
    const all = [{ s: 0, m: 0 }, ...MARGINS_S.map((s) => ({ s, m: 0 })), ...metres.map((m) => ({ s: 0, m }))];
    this.margins.replaceChildren(...all.map((one) => {
      const isChosen = one.s === chosenS && one.m === chosenM;
      return new Option(one.s || one.m ? `margin ${marginText(one)}` : "no margin", JSON.stringify(one), isChosen, isChosen);
    }));
  }

  get hasMargin() {
    return this.margin.s > 0 || this.margin.m > 0;
  }

  // "clear by 0.5 nmi", "clear, no margin", or what is within the margin of it, by keys.
  clearText(nearer) {
    if (!this.hasMargin) return "clear, no margin";
    return nearer.length ? `clear, not by ${marginText(this.margin)} (${nearer.map(printable).join(", ")})` : `clear by ${marginText(this.margin)}`;
  }

  // Fills the container: a heading "What if KEY moves", then parts.
  fill(verb, hue, ...parts) {
    const { container } = this;
    container.replaceChildren(
      element("header", {},
        element("h2", { tabindex: "-1" }, "What if ", element("bdi", { class: `key-${hue}` }, printable(this.key)), ` ${verb}`),
        element("button", { type: "button", class: "plain", "aria-label": "Close", click: () => this.close() }, "✕")),
      ...parts);
    container.hidden = false;
    container.querySelector("h2").focus({ preventScroll: true });
  }

  // The buttons that store a plan, and what they say.
  makeWriting() {
    this.stored = element("p", { role: "status" });
    this.writing = element("div", { class: "stores", hidden: true },
      element("button", { type: "button", click: () => this.propose() }, "Propose"),
      element("button", { type: "button", click: () => this.apply() }, "Apply"));
  }

  offerWriting(isOffered) {
    const { may_edit: mayEdit, branch_of: parent } = this.on.rights();
    this.writing.hidden = !mayEdit || !isOffered;
    this.writing.firstChild.hidden = parent !== null; // a branch has no branches
  }

  close() {
    if (!this.isOpen) return;
    this.key = null;
    this.asked += 1;
    this.hideHandles();
    this.container.hidden = true;
    this.container.replaceChildren();
    this.on.close();
  }

  // Asks the server for the conflicts of the moved plan: one question at a time, the last one again.
  async probe() {
    this.isOutdated = true;
    if (this.isProbing) return;
    this.isProbing = true;
    while (this.isOutdated && this.asksServer) {
      this.isOutdated = false;
      const { asked } = this;
      const isHere = () => asked === this.asked && this.asksServer;
      try {
        const { s, m } = this.margin;
        const { conflicts, nearer } = await this.on.probe({ ...this.what, margin_s: s, margin_m: m });
        if (isHere()) this.show(conflicts.map(probed), nearer);
      } catch (error) {
        if (isHere()) this.summary.textContent = `Not known: ${printable(error.message)}.`;
      }
    }
    this.isProbing = false;
  }

  // How many of the planned conflicts are gone, how many have come, and how many there are.
  compared(conflicts) {
    const now = new Set(conflicts.map(({ other }) => other));
    return { gone: [...this.planned].filter((key) => !now.has(key)).length, come: [...now].filter((key) => !this.planned.has(key)).length, all: now.size };
  }

  // "2 fewer, none new; 1 in all", or without conflicts what `clear` says.
  changeText({ gone, come, all }, clear) {
    return `${gone || "none"} fewer, ${come || "none"} new; ${all ? `${all} in all` : clear}`;
  }

  // Stores the moved plan in a new branch.
  async propose() {
    const branch = `${this.scene}: ${this.key} ${this.moveText()}`;
    if (await this.store({ ...this.what, branch }) === null) return;
    this.stored.replaceChildren("Proposed as the branch ", element("bdi", {}, printable(branch)), ". ",
      element("button", { type: "button", class: "link", click: () => this.on.openScene(branch) }, "Open"));
  }

  // Stores the moved plan in the scene, which is then as planned.
  async apply(what = this.what, isUndo = false) {
    const [key, said, undo] = [this.key, this.moveText(), this.undoOf(what)];
    const plan = await this.store({ ...what, branch: null });
    if (plan === null || this.key !== key) return;
    this.takeStored(plan);
    if (isUndo) this.stored.replaceChildren("Undone.");
    else this.stored.replaceChildren(`Applied: ${said}. `, element("button", { type: "button", class: "link", click: () => this.apply({ ...this.what, ...undo }, true) }, "Undo"));
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
