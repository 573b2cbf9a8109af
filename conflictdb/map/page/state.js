// What the page shows: a scene, an instant of it, what the filter leaves, and the conflict that is chosen. It draws nothing.

import { changesOf } from "./changes.js";
import { Filter, isThere, meet, Model, worstFirst } from "./model.js";

export class State {
  constructor() {
    this.model = null; // the scene, once it is read
    this.version = 0; // of the scene
    this.t = 0; // the instant
    this.filter = new Filter();
    this.left = []; // the conflicts that the filter leaves
    this.hiddenObjects = new Set(); // keys of those that it does not leave
    this.hiddenConflicts = new Set(); // ids
    this.chosen = null; // a conflict
    this.baseline = null; // objects and conflicts that changes count from
    this.changes = null; // since then: { conflicts, text } (changes.js)
    this.showsChanges = false; // rather than all conflicts
    this.selected = null; // the key of an object
    this.hues = null; // keys of objects that keep the colours of a pair while a plan is moved, or null
    this.plan = null; // of a track that departs at another time: { key, laterUs, conflicts } (what_if.js)
  }

  // --- the scene -----------------------------------------------------------------------------------------------------

  takeAll(scene, areas, tracks, outlines, conflicts) {
    const model = new Model(scene);
    model.takeObjects(areas, tracks, outlines);
    if (this.model) model.ranked = this.model.ranked; // until it is read again
    model.takeConflicts(conflicts);
    [this.model, this.version] = [model, scene.version];
    this.findChanges();
  }

  takeConflicts(scene, conflicts) {
    this.model.scene = scene;
    this.model.takeConflicts(conflicts);
    this.version = scene.version;
    this.findChanges();
  }

  takeRanked(ranked) {
    this.model.takeRanked(ranked);
  }

  findChanges() {
    if (this.baseline === null) this.dismissChanges();
    else this.changes = changesOf(this.baseline, this.model);
    if (this.changes.text === null) this.showsChanges = false;
  }

  // Changes count from a state { objects, conflicts, label }.
  compare(baseline) {
    this.baseline = baseline;
    this.findChanges();
  }

  // Changes count from now on.
  dismissChanges() {
    const { objects, conflicts } = this.model;
    this.baseline = { objects, conflicts };
    this.changes = { conflicts: [], text: null };
    this.showsChanges = false;
  }

  // Shows nothing more of the scene, which may no longer be seen, or is no more.
  forget(why) {
    const { scene, span } = this.model;
    this.model = new Model({ ...scene, is_current: false });
    Object.assign(this.model, { span, refused: why });
    this.dismissChanges();
    this.baseline = null;
  }

  // --- the instant ---------------------------------------------------------------------------------------------------

  // At the first conflict of the list: where most of its separation is missing, or else where it begins; or where the scene begins.
  moveToWorst() {
    const { conflicts, tracks, span } = this.model;
    const [worst] = worstFirst(conflicts);
    const at = [worst?.deepest ?? null, worst?.start ?? null, worst?.end ?? null].find((t) => t !== null && Number.isFinite(t));
    this.t = at ?? (tracks.length ? span[0] : Date.now() / 1000);
  }

  // An instant, or the nearest that the scene has.
  moveTo(at) {
    const [from, to] = this.model.span;
    this.t = Math.min(to, Math.max(from, at));
  }

  isAtEnd() {
    return this.t >= this.model.span[1];
  }

  // Whether a conflict is on.
  isOn({ periods, change }) {
    return change !== "gone" && periods.some(([a, b]) => this.t >= a && this.t <= b);
  }

  // The keys of all objects that are in a conflict that the filter leaves.
  inConflict() {
    return new Set(this.left.filter((one) => this.isOn(one)).flatMap(({ a, b }) => [a, b]));
  }

  // How many conflicts that the filter leaves are on, and in how many seconds the next one begins (null: none does).
  ahead() {
    let [now, next] = [0, Infinity];
    for (const conflict of this.left) {
      if (this.isOn(conflict)) now += 1;
      if (conflict.change === "gone") continue;
      for (const [start] of conflict.periods) if (start > this.t) next = Math.min(next, start);
    }
    return { now, next: Number.isFinite(next) ? next - this.t : null };
  }

  // --- the filter ----------------------------------------------------------------------------------------------------

  applyFilter() {
    const { filter, model } = this;
    const conflicts = this.showsChanges ? this.changes.conflicts : this.plan ? model.withPlan(this.plan) : model.conflicts;
    this.left = conflicts.filter((conflict) => filter.leaves(conflict, model, this.t));
    const kept = new Set(this.left.flatMap(({ a, b }) => [a, b]));
    const isHidden = (object) => (
      !filter.leavesObject(object) || (filter.text.trim() !== "" && !filter.names(object) && !kept.has(object.key)));
    this.hiddenObjects = new Set([...model.areas, ...model.tracks].filter(isHidden).map(({ key }) => key));
    // Regions of conflicts that a moved plan changes are not where it would meet.
    const ids = new Set(this.left.filter(({ change }) => change === undefined).map(({ id }) => id));
    this.hiddenConflicts = new Set(model.conflicts.filter(({ id }) => !ids.has(id)).map(({ id }) => id));
  }

  // --- the conflict that is chosen -----------------------------------------------------------------------------------

  // null: none.
  choose(conflict) {
    this.chosen = conflict;
  }

  // The keys of objects A and B, which have colours of their own.
  pair() {
    const { chosen, hues } = this;
    return chosen ? [chosen.a, chosen.b] : hues ?? [];
  }

  hueOf(key) {
    return this.pair()[1] === key ? "b" : "a";
  }

  // The track that the side view is about: of the chosen pair, or else the selected object; null: none.
  subject() {
    const { chosen, model } = this;
    const keys = chosen ? [chosen.a, chosen.b] : [this.selected];
    return keys.map((key) => model.objects.get(key)).find((object) => object?.kind === "track") ?? null;
  }

  // The objects and conflicts that the filter leaves, as the side view takes them.
  side() {
    const { model, chosen, hiddenObjects, left, version } = this;
    const objects = [...model.areas, ...model.tracks].filter(({ key }) => !hiddenObjects.has(key));
    return { objects, conflicts: left, subject: this.subject(), pair: chosen ? [chosen.a, chosen.b] : [], version };
  }

  // Chooses the same conflict, or another one of the same pair, among those that were read again.
  chooseAgain() {
    const { chosen, model: { conflicts } } = this;
    this.chosen = conflicts.find(({ id }) => id === chosen.id) ?? conflicts.find(({ a, b }) => a === chosen.a && b === chosen.b) ?? null;
  }

  // The conflict so many further on among those that the filter leaves, from the one that is chosen, or else from now; null if
  // it leaves none.
  neighbour(by) {
    const { left, chosen } = this;
    if (!left.length) return null;
    const n = chosen ? left.findIndex(({ id }) => id === chosen.id) : by > 0 ? left.findIndex((c) => c.start >= this.t) - 1 : left.length;
    return left[Math.min(left.length - 1, Math.max(0, n + by))];
  }

  // Returns what says of an object or a conflict how it is shown: on, hidden, chosen, of a chosen pair which (a, b), or dimmed
  // since another pair is chosen. Conflicts at heights where the chosen one cannot be are hidden.
  flags() {
    const { model, chosen, t, hiddenObjects, hiddenConflicts } = this;
    const heights = chosen && model.heightsOf(chosen);
    const pair = this.pair();
    return (one) => {
      if (one.key === undefined) {
        const isChosen = one.id === chosen?.id;
        const isApart = heights !== null && !isChosen && !meet(heights, model.heightsOf(one));
        return {
          on: this.isOn(one), hidden: isApart || hiddenConflicts.has(one.id), chosen: isChosen, dim: chosen !== null && !isChosen,
        };
      }
      const [a, b] = [one.key === pair[0], one.key === pair[1]];
      return {
        on: isThere(one, t), hidden: hiddenObjects.has(one.key),
        chosen: a || b, dim: chosen !== null && !a && !b, a, b,
      };
    };
  }
}
