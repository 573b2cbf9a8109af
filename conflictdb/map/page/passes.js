// What a track passes, whatever the heights: when it shares a place with each other object, by the kernel.

import { alone, pairsNear, together, unbounded } from "./near.js";

// Spans of time in which an object of a pack shares a place with others: [[from, to], …], Unix seconds, by their keys.
export function passesOf(kernel, pack, key) {
  const object = pack.objects.indexOf(key);
  if (object < 0) return new Map();
  const near = pairsNear(kernel, pack, object, { isTimed: true, isAllowed: true }).filter(({ isCovered }) => !isCovered);
  if (!near.length) return new Map();
  const { pieces, pairs } = alone(pack, near.map((pair) => ({ ...pair, a: pair.mine, b: pair.other })));
  const asked = together(pieces, pairs.map(({ mine, other }) => ({ a: mine, b: other })));
  const contacts = kernel.withScene(pieces, null, (scene) => kernel.contacts(scene, { ...asked, beyond: null, ofObjects: null }, { separation_m: 0, tolerance_m: 0 }));
  const others = [...new Set(contacts.map(({ pair }) => pieces.object[pairs[pair].other]))];
  const groups = kernel.merge(contacts.map(({ pair, ...contact }) => (
    { ...contact, from: asked.zero[pair], to: asked.to[pair], group: others.indexOf(pieces.object[pairs[pair].other]) })), others.length);
  const base = Number(pack.base_us) / 1e6;
  return new Map(groups.map(({ periods }, n) => [pack.objects[others[n]], periods.map((period) => period.map((us) => base + unbounded(us) / 1e6))]));
}
