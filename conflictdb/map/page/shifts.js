// Pairs of pieces of which one is earlier or later: conflictdb/core/delays.py. A shift is { a, b (rows), aZero, bZero
// (microseconds), aStart, aEnd, bStart, bEnd, least, most (seconds since these) }.

import { climbs, overlapOfLeg, surelyOverlap } from "./climbs.js";
import { DIFFERENCE } from "./kernel.js";

export const ROUNDING_US = 0.1; // more than times of pieces are rounded by
const LOOSE_S = 1; // where more stays open between outer and inner interval, times are halved
const MOST_SPLITS = 6;

// What brings shifts within a reach: { state, outer, inner } each, seconds.
export function differencesOf(kernel, scene, shifts, reachM) {
  const numbers = (name) => Float64Array.from(shifts, (shift) => shift[name]);
  const integers = (name) => BigInt64Array.from(shifts, (shift) => BigInt(shift[name]));
  return kernel.differences(scene, {
    a: integers("a"), b: integers("b"), aZero: integers("aZero"), bZero: integers("bZero"), aStart: numbers("aStart"), aEnd: numbers("aEnd"),
    bStart: numbers("bStart"), bEnd: numbers("bEnd"), least: numbers("least"), most: numbers("most"),
  }, reachM);
}

// The same of shifts that something brings within the reach, as { of: shift, outer, inner }: several of one whose times are halved.
export function solved(kernel, scene, shifts, reachM) {
  const done = [];
  let open = shifts.map((shift) => ({ of: shift, shift }));
  for (let split = 0; open.length; split += 1) {
    const loose = [];
    differencesOf(kernel, scene, open.map(({ shift }) => shift), reachM).forEach(({ state, outer, inner }, n) => {
      if (state === DIFFERENCE.NONE) return;
      const isKnown = state === DIFFERENCE.UNKNOWN || outer[1] - outer[0] <= Math.max(0, inner[1] - inner[0]) + LOOSE_S || split === MOST_SPLITS;
      if (isKnown) done.push({ of: open[n].of, outer, inner, isInner: state === DIFFERENCE.INNER });
      else loose.push(open[n]);
    });
    open = loose.flatMap(({ of, shift }) => halved(shift).map((half) => ({ of, shift: half })));
  }
  return done;
}

// The two halves of the longer time of a shift.
function halved(shift) {
  const name = shift.aEnd - shift.aStart >= shift.bEnd - shift.bStart ? "a" : "b";
  const middle = (shift[`${name}Start`] + shift[`${name}End`]) / 2;
  return [{ ...shift, [`${name}End`]: middle }, { ...shift, [`${name}Start`]: middle }];
}

// A shift cut to the times at which the heights of both may overlap, with `isLevel`: they surely do then; null: never.
// heights(row): those of its leg; band(row): its floor and ceiling; leg(row): start and end, microseconds.
export function atHeights(shift, heights, band, leg) {
  const cut = { ...shift };
  for (const [one, other, name] of [[shift.a, shift.b, "a"], [shift.b, shift.a, "b"]]) {
    if (!climbs(heights(one))) continue;
    const [start, end] = leg(one);
    const since = (start - shift[`${name}Zero`]) / 1e6;
    const { first, last } = overlapOfLeg(heights(one), band(other), (end - start) / 1e6);
    cut[`${name}Start`] = Math.max(cut[`${name}Start`], since + first);
    cut[`${name}End`] = Math.min(cut[`${name}End`], since + last);
  }
  if (!(cut.aStart <= cut.aEnd && cut.bStart <= cut.bEnd)) return null;
  return { ...cut, isLevel: surelyOverlap(heights(shift.a), heights(shift.b)) };
}
