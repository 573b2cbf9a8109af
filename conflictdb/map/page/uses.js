// Uses of one place by two pieces within the separation in time: conflictdb/core/uses.py, uses_of_tracks.py. Instants and
// spans are microseconds.

import { CONTACT, DIFFERENCE } from "./kernel.js";
import { atHeights, differencesOf, ROUNDING_US, solved } from "./shifts.js";

const SHIFTS = 17; // at which two tracks are tested for an overlap deeper than the tolerance
const AIM_S = 1e-3; // ends are found to this
const LADDER = 10; // between the times within which a contact next to an end is looked for

const inUs = ([low, high], between, sign) => [1e6 * low + between - sign * ROUNDING_US, 1e6 * high + between + sign * ROUNDING_US];

// When each of two spans is within a time of the other.
export function nearInTime(a, b, withinUs) {
  const near = (one, other) => [Math.max(one[0], other[0] - withinUs), Math.min(one[1], other[1] + withinUs)];
  return { a: near(a, b), b: near(b, a) };
}

// A use { a, b (spans), verdict, touches, error, lacking, lackingError } as a contact during the time of both; one that ends before
// it starts is unresolved while both are there.
export function asContact(use, whole) {
  const isOrdered = use.a[0] <= use.a[1] && use.b[0] <= use.b[1] && use.error >= 0;
  const { a, b } = isOrdered ? use : whole;
  const [start, end] = [Math.min(a[0], b[0]), Math.max(a[1], b[1])];
  if (isOrdered) return { ...use, start, end };
  return { ...use, start, end, error: (end - start) / 1e6, verdict: CONTACT.UNRESOLVED, touches: true, lacking: NaN, lackingError: NaN };
}

// The use of an area by a track, from their contact { start, end, verdict, touches, error } while the area, whose span is
// given, is there for longer by the separation in time.
export function useOfArea(contact, span, withinUs) {
  const { start, end, error, verdict } = contact;
  const isOpen = verdict === CONTACT.UNRESOLVED;
  const lacking = (withinUs - Math.max(0, start - span[1], span[0] - end)) / 1e6;
  return {
    ...contact, a: [start, end], b: [Math.max(span[0], start - withinUs), Math.min(span[1], end + withinUs)],
    lacking: isOpen ? NaN : lacking, lackingError: isOpen ? NaN : Math.min(error, lacking),
  };
}

// The uses of pairs { a, b } of pieces of tracks: { ...pair, a, b (spans), … } each. span(row), and heights, band and leg of a row
// as of `atHeights`. sceneOf(rows, by, ask) calls `ask` with a scene of rows, each earlier by so many microseconds.
export function usesOfTracks(kernel, pairs, { separation_m: separation, tolerance_m: tolerance, within_us: withinUs }, { span, heights, band, leg, sceneOf }) {
  const shifts = pairs.map((pair) => {
    const [[aZero, aUntil], [bZero, bUntil]] = [span(pair.a), span(pair.b)];
    const between = bZero - aZero;
    const [least, most] = [-1, 1].map((sign) => (sign * (withinUs + ROUNDING_US) - between) / 1e6);
    return atHeights({ pair, a: pair.a, b: pair.b, aZero, bZero, aStart: 0, aEnd: (aUntil - aZero) / 1e6, bStart: 0, bEnd: (bUntil - bZero) / 1e6, least, most }, heights, band, leg);
  }).filter(Boolean);
  const ask = (rows, reachM, touches) => (rows.length ? ofReach(kernel, rows, { reachM, touches, separation, tolerance, withinUs, span, sceneOf }) : []);
  const met = ask(shifts, separation, true);
  const known = new Set(met.map(({ shift }) => shift));
  const rest = tolerance > 0 ? ask(shifts.filter((shift) => !known.has(shift)), separation + tolerance, false) : [];
  return [...met, ...rest];
}

const isWithin = ([low, high], withinUs) => Math.max(low, -withinUs) <= Math.min(high, withinUs);

function ofReach(kernel, shifts, options) {
  const { reachM, touches, withinUs, span, sceneOf } = options;
  const rows = shifts.flatMap(({ a, b }) => [a, b]);
  return sceneOf(rows, null, (scene) => {
    const own = shifts.map((shift, n) => ({ ...shift, of: shift, a: 2 * n, b: 2 * n + 1, between: shift.bZero - shift.aZero }));
    const known = new Map();
    for (const { of, outer, inner, isInner } of solved(kernel, scene, own, reachM)) {
      known.set(of, [...(known.get(of) ?? []), { outer: inUs(outer, of.between, 1), sure: isInner ? inUs(inner, of.between, -1) : null }]);
    }
    const isSure = ({ sure }) => sure !== null && isWithin(sure, withinUs);
    // A pair without a proven contact is asked about all differences: ends are sharper that way.
    const doubtful = [...known].filter(([, some]) => !some.some(isSure)).map(([of]) => ({ ...of, original: of, least: -Infinity, most: Infinity }));
    const near = new Set(solved(kernel, scene, doubtful, reachM).filter(({ of, outer }) => {
      const [low, high] = inUs(outer, of.between, 1);
      return !(low > withinUs || high < -withinUs);
    }).map(({ of }) => of.original));
    for (const { original } of doubtful) if (!near.has(original)) known.delete(original);
    const asked = [...known].map(([shift, some]) => {
      const clipped = some.map(({ outer }) => outer.map((us) => Math.min(withinUs, Math.max(-withinUs, us))));
      const gaps = (spans) => Math.min(Infinity, ...spans.map(([low, high]) => Math.max(0, low, -high)));
      const widest = clipped.reduce((best, one) => (one[1] - one[0] >= best[1] - best[0] ? one : best));
      return { shift, widest, gap: gaps(clipped), sureGap: gaps(some.filter(isSure).map(({ sure }) => sure)) };
    });
    if (!asked.length) return [];
    test(kernel, asked, options);
    const ends = endsOf((some) => differencesOf(kernel, scene, some, reachM), asked.map(({ shift }) => shift), withinUs);
    return asked.flatMap(({ shift, gap, sureGap, verdict: tested }, n) => {
      const { at, error } = ends[n];
      const isApart = (at[0] > at[1] || at[2] > at[3]) && sureGap === Infinity && tested !== CONTACT.CONFLICT;
      if (isApart) return [];
      let verdict = tested === CONTACT.CONFLICT ? tested : sureGap < Infinity ? CONTACT.GRAZING : tested;
      if (!shift.isLevel) verdict = CONTACT.UNRESOLVED;
      const isOpen = verdict === CONTACT.UNRESOLVED;
      const lacking = Math.max(Math.round(withinUs - gap), 0) / 1e6;
      const times = (zero, first, last) => [zero + Math.floor(1e6 * first), zero + Math.ceil(1e6 * last)];
      const use = {
        a: times(shift.aZero, at[0], at[1]), b: times(shift.bZero, at[2], at[3]), verdict, touches, error,
        lacking: isOpen ? NaN : lacking, lackingError: isOpen ? NaN : Math.min((sureGap - gap + 1) / 1e6, lacking),
      };
      const { pair } = shift.of;
      return [{ shift: shift.of, pair, ...asContact(use, nearInTime(span(pair.a), span(pair.b), withinUs)) }];
    });
  });
}

// Sets `verdict` of asked { shift, widest }: conflict if at some tested shift they are deeper than the tolerance.
function test(kernel, asked, { separation, tolerance, span, sceneOf }) {
  for (const one of asked) one.verdict = CONTACT.UNRESOLVED;
  const shares = Array.from({ length: SHIFTS }, (_, n) => n / (SHIFTS - 1));
  const middle = (SHIFTS - 1) / 2;
  for (const some of [[shares[middle]], shares.filter((_, n) => n !== middle)]) {
    const tested = asked.filter(({ verdict }) => verdict !== CONTACT.CONFLICT).flatMap((one) => some.map((share) => {
      const by = Math.round(one.widest[0] + share * (one.widest[1] - one.widest[0]));
      const [a, b] = [span(one.shift.of.a), span(one.shift.of.b).map((us) => us - by)];
      return { one, by, from: Math.max(a[0], b[0]), to: Math.min(a[1], b[1]) };
    })).filter(({ from, to }) => from <= to);
    if (!tested.length) continue;
    const rows = tested.flatMap(({ one: { shift: { of } } }) => [of.a, of.b]);
    sceneOf(rows, tested.flatMap(({ by }) => [0, by]), (scene) => {
      const integers = (of) => BigInt64Array.from(tested, (one, n) => BigInt(of(one, n)));
      for (const { pair, verdict } of kernel.contacts(scene, {
        a: integers((_, n) => 2 * n), b: integers((_, n) => 2 * n + 1), zero: integers(({ from }) => from), low: new Float64Array(tested.length),
        high: Float64Array.from(tested, ({ from, to }) => (to - from) / 1e6), beyond: null, ofObjects: null,
      }, { separation_m: separation, tolerance_m: tolerance })) {
        const { one } = tested[pair];
        if (verdict === CONTACT.CONFLICT || (verdict === CONTACT.GRAZING && one.verdict !== CONTACT.CONFLICT)) one.verdict = verdict;
      }
    });
  }
}

// The first and last times of contact within the separation in time, of a and of b, seconds: { at: [4], error } of each shift. By
// bisection: the kernel proves that they do not meet before a time, or up to it they do.
function endsOf(ask, shifts, withinUs) {
  const ends = shifts.flatMap((shift) => [0, 1, 2, 3].map((end) => {
    const name = end < 2 ? "a" : "b";
    const [start, stop] = [shift[`${name}Start`], shift[`${name}End`]];
    return { shift, end, name, start, stop, low: 0, high: stop - start, error: 0 };
  }));
  const asked = (some, goneOf) => ask(some.map((one) => {
    const [{ shift, name, start, stop }, gone] = [one, goneOf(one)];
    return { ...shift, ...(one.end % 2 ? { [`${name}Start`]: Math.max(stop - gone, start) } : { [`${name}End`]: Math.min(start + gone, stop) }) };
  }));
  const isApart = ({ state }) => state === DIFFERENCE.NONE;
  asked(ends, () => 0).forEach((found, n) => { if (!isApart(found)) ends[n].high = 0; });
  for (let left = ends; (left = left.filter(({ low, high }) => high - low > AIM_S)).length;) {
    const middle = ({ low, high }) => (low + high) / 2;
    asked(left, middle).forEach((found, n) => {
      if (isApart(found)) left[n].low = middle(left[n]);
      else left[n].high = middle(left[n]);
    });
  }
  for (let [left, step] = [ends, 0]; left.length; step = Math.max(LADDER * step, AIM_S)) {
    const until = ({ high, start, stop }) => Math.min(high + step, stop - start);
    const found = asked(left, until);
    left = left.filter((one, n) => {
      const { between } = one.shift;
      const [first, last] = found[n].inner.map((s) => 1e6 * s + between);
      const isMet = Math.max(first, ROUNDING_US - withinUs) <= Math.min(last, withinUs - ROUNDING_US) || until(one) >= one.stop - one.start;
      if (isMet) one.error = until(one) - one.low;
      return !isMet;
    });
  }
  return shifts.map((_, n) => {
    const own = ends.slice(4 * n, 4 * n + 4);
    return { at: own.map(({ start, stop, low, end }) => (end % 2 ? stop - low : start + low)), error: Math.max(...own.map(({ error }) => error)) };
  });
}
