// The distance of two objects over time, by the kernel: how deep they overlap, and when most.

import { CONTACT, Kernel } from "./kernel.js";
import { mayMeet, rowsOf, taken, together, unbounded, unpackPieces } from "./near.js";

const SAMPLES = 96;
const MOST_ASKED = 20_000; // distances of two pieces at an instant: some tenths of a second
const PAD_SHARE = 0.3; // of the time of a conflict, that is shown before and after it
const LEAST_PAD_S = 30;
const ERRORS_M = [0.01, 0.1, 1, 10, 100]; // that are tried

export class PairDistance {
  constructor(kernel, pack, keys) {
    this.kernel = kernel;
    this.base = Number(pack.base_us) / 1e6;
    const [a, b] = keys.map((key) => pack.objects.indexOf(key));
    const rows = Array.from(pack.object.keys()).filter((row) => pack.object[row] === a || pack.object[row] === b);
    const pieces = taken(pack, rows);
    this.pieces = pieces;
    const of = (object) => [...rows.keys()].filter((row) => pieces.object[row] === object);
    const every = of(a).flatMap((one) => of(b).map((other) => [one, other]));
    const isMet = mayMeet(kernel, rowsOf(pieces, { times: pieces }), every);
    this.pairs = every.filter((_, n) => isMet[n]).map(([one, other]) => ({ a: one, b: other }));
    this.isWhole = !pieces.is_cover.includes(1) && this.pairs.length > 0;
    const [{ a: one, b: other } = { a: 0, b: 0 }] = this.pairs;
    this.separationM = pack.settings[Math.max(pack.of_types[pieces.type[one]][pieces.type[other]], 0)].separation_m;
    this.start = Array.from(pieces.start_us, (us) => unbounded(us) / 1e6);
    this.end = Array.from(pieces.end_us, (us) => unbounded(us) / 1e6);
    // An area of several parts is deeper than each of them.
    this.isOfParts = [a, b].some((object) => of(object).filter((row) => pieces.moves[row] === 0).length > 1);
  }

  // Distances at instants (Unix seconds), metres: null where one of the objects is not there, or it is not known.
  at(instants) {
    const asked = [];
    instants.forEach((instant, n) => {
      const t = instant - this.base;
      for (const { a, b } of this.pairs) {
        if (t >= Math.max(this.start[a], this.start[b]) && t <= Math.min(this.end[a], this.end[b])) asked.push({ n, a, b, us: Math.round(1e6 * t) });
      }
    });
    const nearest = instants.map(() => null);
    if (!asked.length || asked.length > MOST_ASKED) return nearest;
    const integers = (of) => BigInt64Array.from(asked, (one) => BigInt(of(one)));
    const found = this.kernel.withScene(this.pieces, null, (scene) => this.kernel.distances(scene, {
      a: integers(({ a }) => a), b: integers(({ b }) => b), zero: integers(({ us }) => us), low: new Float64Array(asked.length),
    }));
    found.forEach((metres, i) => {
      const { n } = asked[i];
      if (!Number.isNaN(metres)) nearest[n] = Math.min(nearest[n] ?? Infinity, metres);
    });
    return nearest;
  }

  // Samples around a conflict, [[t, metres], …], and the least distance: { samples, least: [t, metres, error] }; null: not known.
  around({ start, end, periods }) {
    if (!this.isWhole || !Number.isFinite(start) || !Number.isFinite(end)) return null;
    const pad = Math.max(LEAST_PAD_S, PAD_SHARE * (end - start));
    const [from, to] = [start - pad, end + pad];
    const times = Array.from({ length: SAMPLES }, (_, n) => from + (n * (to - from)) / (SAMPLES - 1));
    const every = [...times, ...periods.flatMap(([a, b]) => [a, (a + b) / 2, b])].sort((a, b) => a - b);
    const metres = this.at(every);
    const samples = every.flatMap((t, n) => (metres[n] === null ? [] : [[t, metres[n]]]));
    if (samples.length < 2) return null;
    return { samples, least: this.least(from, to), separationM: this.separationM, isOfParts: this.isOfParts };
  }

  // The least distance between two instants, when, and by how much it may be less: [t, metres, metres].
  least(from, to) {
    const every = together(this.pieces, this.pairs);
    const [first, last] = [from, to].map((t) => every.low.map((_, n) => t - this.base - Number(every.zero[n]) / 1e6));
    const there = [...first.keys()].filter((n) => first[n] <= every.high[n] && last[n] >= 0);
    const some = (values) => values.constructor.from(there, (n) => values[n]);
    const asked = {
      a: some(every.a), b: some(every.b), zero: some(every.zero), low: some(first.map((s) => Math.max(0, s))),
      high: some(last.map((s, n) => Math.min(every.high[n], s))),
    };
    return this.kernel.withScene(this.pieces, null, (scene) => {
      const found = this.kernel.deepest(scene, asked);
      const n = found.reduce((best, { m }, k) => (m < found[best].m ? k : best), 0);
      return [this.base + Number(asked.zero[n]) / 1e6 + found[n].at, found[n].m, this.errorOf(scene, asked, found[n].m)];
    });
  }

  // By how much pairs may be nearer or deeper than they were seen, metres: no contact is deeper than that by more.
  errorOf(scene, asked, m) {
    return ERRORS_M.find((error) => this.kernel.contacts(scene, { ...asked, beyond: null, ofObjects: null }, {
      separation_m: Math.max(0, m), tolerance_m: Math.max(0, -m) + error,
    }).every(({ verdict }) => verdict === CONTACT.GRAZING)) ?? Infinity;
  }
}

// What is known of the distance of the pair of a conflict of which one is a track; null: nothing.
export async function distanceAround(source, kernel, conflict, track) {
  const [functions, pieces] = await Promise.all([kernel(), source.pieces(track, 0)]);
  const pack = unpackPieces(pieces);
  if (![conflict.a, conflict.b].every((key) => pack.objects.includes(key))) return null;
  return new PairDistance(functions, pack, [conflict.a, conflict.b]).around(conflict);
}

// The kernel, which is loaded when it is first needed.
export function kernelOf(source) {
  let loaded = null;
  return () => {
    loaded ??= source.kernel().then((bytes) => Kernel.of(bytes)).catch((error) => {
      loaded = null;
      throw error;
    });
    return loaded;
  };
}
