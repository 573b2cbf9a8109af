// The distance of two objects over time, by the kernel: how deep they overlap, and when most.

import { Kernel } from "./kernel.js";
import { settingsOf, taken, unbounded, unpackPieces } from "./what_if.js";

const SAMPLES = 96;
const MOST_ASKED = 20_000; // distances of two pieces at an instant: some tenths of a second
const PAD_SHARE = 0.3; // of the time of a conflict, that is shown before and after it
const LEAST_PAD_S = 30;
const STEPS = 24; // of the search for the deepest instant
const GOLDEN = (Math.sqrt(5) - 1) / 2;

export class PairDistance {
  constructor(kernel, pack, keys) {
    this.kernel = kernel;
    this.base = Number(pack.base_us) / 1e6;
    const [a, b] = keys.map((key) => pack.objects.indexOf(key));
    const rows = Array.from(pack.object.keys()).filter((row) => pack.object[row] === a || pack.object[row] === b);
    this.pieces = taken(pack, rows);
    const settings = settingsOf(pack, ...[a, b].map((object) => rows.find((row) => pack.object[row] === object)));
    this.separationM = pack.settings[Math.max(settings, 0)].separation_m;
    this.pairs = [];
    rows.forEach((one, i) => rows.forEach((other, j) => {
      if (pack.object[one] === a && pack.object[other] === b && (pack.turn[one] === 0 || pack.turn[other] === 0)) this.pairs.push([i, j]);
    }));
    this.isWhole = !pack.is_cover.some((isCover, row) => isCover && rows.includes(row)) && this.pairs.length > 0;
    this.start = Array.from(this.pieces.start_us, (us) => unbounded(Number(us)) / 1e6);
    this.end = Array.from(this.pieces.end_us, (us) => unbounded(Number(us)) / 1e6);
    // An area of several parts is deeper than each of them.
    this.isOfParts = [a, b].some((object) => rows.filter((row) => pack.object[row] === object && pack.moves[row] === 0).length > 1);
  }

  // Distances at instants (Unix seconds), metres: null where one of the objects is not there, or it is not known.
  at(instants) {
    const asked = [];
    instants.forEach((instant, n) => {
      const t = instant - this.base;
      for (const [a, b] of this.pairs) {
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

  // Samples around a conflict, [[t, metres], …], and the least of them: { samples, least: [t, metres] }; null: not known.
  around({ start, end, periods }) {
    if (!this.isWhole || !Number.isFinite(start) || !Number.isFinite(end)) return null;
    const pad = Math.max(LEAST_PAD_S, PAD_SHARE * (end - start));
    const [from, to] = [start - pad, end + pad];
    const times = Array.from({ length: SAMPLES }, (_, n) => from + (n * (to - from)) / (SAMPLES - 1));
    const every = [...times, ...periods.flatMap(([a, b]) => [a, (a + b) / 2, b])].sort((a, b) => a - b);
    const metres = this.at(every);
    const samples = every.flatMap((t, n) => (metres[n] === null ? [] : [[t, metres[n]]]));
    if (samples.length < 2) return null;
    const n = samples.reduce((best, [, m], i) => (m < samples[best][1] ? i : best), 0);
    const least = this.search(samples[Math.max(0, n - 1)][0], samples[Math.min(samples.length - 1, n + 1)][0], samples[n]);
    return { samples, least, separationM: this.separationM, isOfParts: this.isOfParts };
  }

  // The least distance between two instants, where it falls and rises again.
  search(from, to, known) {
    let [low, high, least] = [from, to, known];
    for (let n = 0; n < STEPS; n += 1) {
      const [t1, t2] = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
      const [m1, m2] = this.at([t1, t2]);
      if (m1 === null || m2 === null) return least;
      if (m1 < least[1]) least = [t1, m1];
      if (m2 < least[1]) least = [t2, m2];
      if (m1 < m2) high = t2;
      else low = t1;
    }
    return least;
  }
}

// What is known of the distance of the pair of a conflict of which one is a track; null: nothing.
export async function distanceAround(source, kernel, conflict, track) {
  const [functions, pieces] = await Promise.all([kernel(), source.pieces(track, 0)]);
  const pack = unpackPieces(pieces);
  if (pack.refusal !== null || ![conflict.a, conflict.b].every((key) => pack.objects.includes(key))) return null;
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
