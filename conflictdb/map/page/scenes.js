// Which scene the page shows, and since when or from which other scene changes count.

import { byId } from "./dom.js";
import { clock, counted, day, printable, zone } from "./format.js";

const HOUR_S = 3600;
const HOURS = 12; // full hours that can be chosen
const FURTHER = [["a day ago", 24 * HOUR_S], ["a week ago", 168 * HOUR_S]];

export class Scenes {
  // `on`: open(name) another scene, compare(choice): { t } or { scene }, with a label, or null for what changed since the page was opened.
  constructor(source, on) {
    this.source = source;
    this.on = on;
    this.choices = [];
    byId("scene").addEventListener("change", () => on.open(byId("scene").value));
    byId("compare").addEventListener("change", () => on.compare(this.choices[Number(byId("compare").value)]));
    for (const id of ["scene", "compare"]) byId(id).addEventListener("focus", () => this.read());
  }

  // Reads which scenes there are, and shows one of them as chosen.
  async read(shown = this.shown) {
    let scenes;
    try {
      ({ scenes } = await this.source.scenes());
    } catch {
      return; // the page says so
    }
    this.take(scenes, shown);
  }

  take(scenes, shown) {
    this.shown = shown;
    const text = JSON.stringify(scenes);
    if (text !== this.known) this.list(scenes);
    [this.known, this.last] = [text, scenes];
    byId("scenes").hidden = false;
  }

  list(scenes) {
    const state = (one) => (one.is_detected ? `${counted(one.conflicts, "conflict")}${one.is_pending ? ", changed since" : ""}` : "never detected");
    const names = scenes.map((one) => (
      new Option(`${printable(one.scene)}: ${state(one)}${one.branch_of === null ? "" : `, branch of ${printable(one.branch_of)}`}`, one.scene, false, one.scene === this.shown)));
    if (!scenes.some(({ scene }) => scene === this.shown)) names.unshift(new Option(`${printable(this.shown)}: not there`, this.shown, true, true));
    byId("scene").replaceChildren(...names);
    this.offer(scenes);
  }

  // In another zone.
  relabel() {
    if (this.last) this.list(this.last);
  }

  offer(scenes) {
    const now = Date.now() / 1000;
    const hours = Array.from({ length: HOURS }, (_, n) => (Math.floor(now / HOUR_S) - n) * HOUR_S);
    const parent = scenes.find(({ scene }) => scene === this.shown)?.branch_of ?? null;
    const others = scenes.map(({ scene }) => scene).filter((scene) => scene !== this.shown).sort((a, b) => (b === parent) - (a === parent));
    const times = [...hours.map((t) => [`${clock(t, false)} ${zone(t)}${day(t) === day(now) ? "" : ", yesterday"}`, t]), ...FURTHER.map(([name, s]) => [name, now - s])];
    const ofTimes = times.map(([label, t]) => ({ label, t }));
    const ofScenes = others.map((scene) => ({ label: `scene ${printable(scene)}${scene === parent ? ", its parent" : ""}`, scene }));
    const before = byId("compare").selectedOptions[0]?.text;
    this.choices = [null, ...ofTimes, ...ofScenes];
    const options = this.choices.map((choice, n) => new Option(choice?.label ?? "the page was opened", n));
    const group = (label, some) => {
      const made = document.createElement("optgroup");
      made.label = label;
      made.append(...some);
      return made;
    };
    byId("compare").replaceChildren(options[0], group("As known at", options.slice(1, 1 + ofTimes.length)),
      ...(ofScenes.length ? [group("Compared with", options.slice(1 + ofTimes.length))] : []));
    for (const option of options) option.selected = option.text === before;
  }

  // Says what may be done with a branch; parent: the scene that it is a branch of, or null. Merging and dropping wait for a second click.
  showBranch(parent, mayEdit) {
    byId("branch").hidden = parent === null || !mayEdit;
    for (const [id, text] of [["merge", `Merge into ${printable(parent ?? "")}`], ["drop", "Drop"]]) {
      byId(id).textContent = text;
      byId(id).onclick = () => this.sure(id, text, parent);
      byId(id).onblur = () => { byId(id).textContent = text; };
    }
  }

  async sure(id, text, parent) {
    const button = byId(id);
    if (button.textContent === text) {
      button.textContent = `${text}: sure?`;
      return;
    }
    byId("branch-said").textContent = "";
    this.source.isLeft = true; // what it says of a branch that goes is not shown
    try {
      await this.source.branch(id);
      this.on.open(parent);
    } catch (error) {
      this.source.isLeft = false;
      button.textContent = text;
      byId("branch-said").textContent = `Not done: ${printable(error.message)}.`;
    }
  }

  // Nothing is compared any more.
  reset() {
    byId("compare").value = "0";
  }
}
