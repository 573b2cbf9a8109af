// What an object comes nearest to, and when, on the ground: by steps between which nothing nearer can be missed.

import { bandAt } from "./heights.js";
import { apartAt, presence } from "./passes.js";

const MOST_STEPS = 4000; // with one other object
const EXACT_M = 1;

// The heights of two objects at an instant have one in common, or are nearer than a separation.
function shareHeights(one, other, t, verticalM) {
  const [a, b] = [bandAt(one, t), bandAt(other, t)];
  return a !== null && b !== null && a[0] < b[1] + verticalM && b[0] < a[1] + verticalM;
}

const varies = ({ floors, ceilings, spans }) => Boolean(floors ?? ceilings ?? spans);

// { other, m, t } of all other objects; null: none is there at its time and heights. rings: of areas, by key.
export function nearestOf(object, objects, rings, verticalM) {
  const own = presence(object, rings.get(object.key));
  if (!own) return null;
  let best = null;
  const others = objects.filter((other) => other.key !== object.key).flatMap((other) => {
    const theirs = presence(other, rings.get(other.key));
    const [from, to] = theirs ? [Math.max(own.span[0], theirs.span[0]), Math.min(own.span[1], theirs.span[1])] : [1, 0];
    if (!(from <= to)) return [];
    const isVaried = varies(object) || varies(other);
    const isNear = (one, two) => (one.floor ?? -Infinity) < (two.ceiling ?? Infinity) + verticalM;
    if (!isVaried && !(isNear(object, other) && isNear(other, object))) return [];
    const at = [Math.max(from, -8.64e12), Math.min(to, 8.64e12)];
    return [{ other, theirs, span: at, isVaried, first: apartAt(own, theirs, Math.min(at[1], Math.max(at[0], (own.span[0] + own.span[1]) / 2 || at[0]))).m }];
  }).sort((a, b) => a.first - b.first);
  for (const { other, theirs, span: [from, to], isVaried } of others) {
    const closing = own.speed + theirs.speed;
    const turns = [...own.turns, ...theirs.turns].filter((t) => t > from && t < to).sort((a, b) => a - b);
    let [t, next] = [from, 0];
    for (let n = 0; n < MOST_STEPS; n += 1) {
      const { m, least } = apartAt(own, theirs, t);
      if ((best === null || m < best.m) && (!isVaried || shareHeights(object, other, t, verticalM))) best = { other, m, t: closing > 0 ? t : Infinity };
      if (t >= to || closing === 0) break;
      while (turns[next] <= t) next += 1;
      const spare = Math.max(EXACT_M, least - (best === null ? 0 : best.m));
      t = Math.min(to, turns[next] ?? to, t + Math.max((to - from) / MOST_STEPS, spare / closing));
    }
  }
  return best;
}
