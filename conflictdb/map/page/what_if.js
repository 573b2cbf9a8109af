// What a track would meet if it departed earlier or later, or went higher or lower: the stages of a detection (conflictdb/core), each by
// the kernel. Instants are microseconds since the base of the pack (near.js).

import { CONTACT, DEPTH, NEVER_BEGAN, NEVER_ENDS, USE } from "./kernel.js";
import { alone, atHeights, heightsUnder, later, mayMeet, pairsNear, rowsOf, together, unbounded } from "./near.js";

const BEYOND_US = 10; // differences are asked for this much beyond the horizon
const ROUNDING_US = 0.1; // more than times of pieces are rounded by
const ROUNDED_M = 1e6; // heights below are rounded to nanometres, where heights have a margin (separations.py)

// The next double above a finite number, or so many further.
function beyond(x, steps = 1n) {
  const bits = new DataView(new ArrayBuffer(8));
  bits.setFloat64(0, x === 0 ? 0 : x);
  if (x < 0 || (x === 0 && steps < 0n)) return -beyond(-x, -steps);
  bits.setBigInt64(0, bits.getBigInt64(0) + steps);
  return bits.getFloat64(0);
}

// The values by their settings: [number of the settings, values] each.
function bySettings(values) {
  const found = new Map();
  for (const one of values) found.set(one.settings, [...(found.get(one.settings) ?? []), one]);
  return [...found];
}

// The floors and ceilings of a plan that are known, metres.
export const limitsOf = ({ properties }) => [properties.floor_m, properties.ceiling_m].flat().filter(Number.isFinite);

// The instant of a span, so much later, if it has one.
const moved = (us, by) => (us === NEVER_BEGAN || us === NEVER_ENDS ? us : us + BigInt(by));

export class WhatIf {
  // A track of a pack by its key. `refusal` says why nothing is known, or is null.
  constructor(kernel, pack, key) {
    this.kernel = kernel;
    this.key = key;
    this.refusal = pack.refusal ?? (pack.objects.includes(key) ? null : "it is never under way");
    if (this.refusal !== null) return;
    this.plan = pack.plans[key];
    this.digest = pack.digests?.[key] ?? null;
    this.pack = pack;
    this.baseUs = BigInt(pack.base_us);
    this.object = pack.objects.indexOf(key);
    const { pieces, pairs } = alone(pack, pairsNear(kernel, pack, this.object));
    this.pieces = pieces;
    this.start = Array.from(pieces.start_us, unbounded);
    this.end = Array.from(pieces.end_us, unbounded);
    this.mayRise = limitsOf(this.plan).length > 0;
    const settled = pairs.map((pair) => ({ ...pair, settings: pack.of_types[pieces.type[pair.mine]][pieces.type[pair.other]] }));
    // At other heights it may meet others.
    this.pairs = this.mayRise ? settled : bySettings(settled).flatMap(([settings, some]) => this.meeting(some, this.heightsAt(settings, 0)));
  }

  // The lowest floor and the highest ceiling of the objects around, metres.
  get heights() {
    const { floor_m: floors, ceiling_m: ceilings } = this.pieces;
    const known = [...floors, ...ceilings].filter(Number.isFinite);
    return known.length ? [Math.min(...known), Math.max(...known)] : [0, 0];
  }

  // The pairs that may meet at some heights, and at their times, if there are any.
  meeting(pairs, heights, times = null, within = 0) {
    const isMet = mayMeet(this.kernel, rowsOf(this.pieces, { heights, times }), pairs.map(({ mine, other }) => [mine, other]), within);
    return pairs.filter((_, n) => isMet[n]);
  }

  // A height of the track if it is so much higher, metres.
  risen(m, upM, isCeiling) {
    if (upM === 0 || !Number.isFinite(m)) return m;
    // The ceilings of closed bands are the next numbers.
    const isNext = isCeiling && this.pack.intervals === "closed";
    const sum = (isNext ? beyond(m, -1n) : m) + upM;
    const rounded = this.pack.has_margins && Math.abs(sum) < ROUNDED_M ? Number(sum.toFixed(9)) : sum;
    return isNext ? beyond(rounded) : rounded;
  }

  // The heights of all pieces under some settings, if the track is so much higher.
  heightsAt(settings, upM) {
    const { floor_m: floor, ceiling_m: ceiling, climb_m: climb } = heightsUnder(this.pieces, settings);
    if (upM === 0) return { floor_m: floor, ceiling_m: ceiling, climb_m: climb };
    const isMine = (row) => this.pieces.object[row] === this.object;
    const rise = (isCeiling) => (m, row) => (isMine(row) ? this.risen(m, upM, isCeiling) : m);
    return {
      floor_m: floor.map(rise(false)), ceiling_m: ceiling.map(rise(true)),
      climb_m: climb && climb.map((m, n) => (isMine(n >> 2) ? this.risen(m, upM, n % 4 > 1) : m)),
    };
  }

  // The keys of the objects that it may meet.
  get others() {
    return [...new Set(this.pairs.map(({ other }) => this.keyOf(other)))];
  }

  keyOf(row) {
    return this.pack.objects[this.pieces.object[row]];
  }

  // Departures that are in conflict, later by [low, high] microseconds, with each object by its key, if the track is so much higher:
  // at no other one within the horizon it comes within the separation and the tolerance of it.
  forbidden(horizonUs, upM = 0) {
    const byKey = new Map();
    const forbid = (row, from, to) => {
      if (!(from <= horizonUs && to >= -horizonUs)) return;
      const key = this.keyOf(row);
      if (!byKey.has(key)) byKey.set(key, []);
      byKey.get(key).push([Math.max(from, -horizonUs), Math.min(to, horizonUs)]);
    };
    for (const [settings, all] of bySettings(this.pairs)) {
      const { separation_m: separation, tolerance_m: tolerance, within_us: within } = this.pack.settings[settings];
      const heights = this.heightsAt(settings, upM);
      const some = this.meeting(all, heights);
      for (const { mine, other } of some.filter(({ isCovered }) => isCovered)) {
        forbid(other, this.start[other] - this.end[mine] - within, this.end[other] - this.start[mine] + within);
      }
      const shifts = some.filter(({ isCovered }) => !isCovered).map((pair) => this.shiftOf(pair, horizonUs + BEYOND_US + within)).filter(({ least, most }) => least <= most);
      for (const { pair, low, high } of this.differencesOf(shifts, heights, separation + tolerance)) {
        const { other, aZero, first, last } = shifts[pair];
        forbid(other, first - aZero + Math.floor(1e6 * low - ROUNDING_US) - within, last - aZero + Math.ceil(1e6 * high + ROUNDING_US) + within);
      }
    }
    return new Map([...byKey].map(([key, spans]) => [key, union(spans)]));
  }

  // A pair as a shift of the track by at most so many microseconds: an area stands still at all instants of its span.
  shiftOf({ mine, other }, mostUs) {
    const { pieces, start, end } = this;
    const isStill = pieces.moves[other] === 0;
    const [aZero, first] = [start[mine], start[other]];
    const last = isStill ? end[other] : first;
    return {
      mine, other, aZero, first, last, bZero: isStill ? aZero : first, aEnd: (end[mine] - aZero) / 1e6, bEnd: isStill ? 0 : (end[other] - first) / 1e6,
      least: (-mostUs - (last - aZero)) / 1e6, most: (mostUs - (first - aZero)) / 1e6,
    };
  }

  // What brings shifts within a reach at some heights: { pair, low, high (seconds) }, several of one.
  differencesOf(shifts, heights, reachM) {
    if (!shifts.length) return [];
    const numbers = (name) => Float64Array.from(shifts, (shift) => shift[name]);
    const integers = (name) => BigInt64Array.from(shifts, (shift) => BigInt(shift[name]));
    return this.kernel.withScene(this.pieces, null, (scene) => this.kernel.differences(scene, { ...this.pieces, ...heights }, {
      a: integers("mine"), b: integers("other"), aZero: integers("aZero"), bZero: integers("bZero"), aEnd: numbers("aEnd"), bEnd: numbers("bEnd"),
      least: numbers("least"), most: numbers("most"),
    }, reachM));
  }

  // The conflicts of the track if it departs so much later, microseconds, and is so much higher, metres: in the order of the other objects,
  // with their periods in Unix seconds, and as `us` in microseconds since the base. A verdict of null: conflict or grazing, of an area of
  // several parts within a separation in time.
  conflicts(laterUs, upM = 0) {
    const now = later(this.pieces, this.object, laterUs);
    const found = bySettings(this.pairs).flatMap(([settings, some]) => this.contactsOf({ ...now, ...this.heightsAt(settings, upM) }, some, this.pack.settings[settings]));
    const objects = [...new Set(found.map(({ other }) => this.pieces.object[other]))].sort((a, b) => a - b);
    const merged = this.kernel.merge(found.map((contact) => ({ ...contact, group: objects.indexOf(this.pieces.object[contact.other]) })), objects.length);
    return merged.map((one, n) => this.conflictOf(now, objects[n], one, found.filter(({ other }) => this.pieces.object[other] === objects[n])));
  }

  // A conflict with an object, of its contacts at the times of pieces.
  conflictOf(now, object, { periods, error, verdict, lackingError }, contacts) {
    const us = periods.map((period) => period.map(unbounded));
    const base = Number(this.baseUs) / 1e6;
    // An overlap that is shallow in all parts of an area may be deep in the whole.
    const isOfParts = verdict === CONTACT.GRAZING && contacts.some(({ touches }) => touches) && this.pieces.moves[contacts[0].other] === 0
      && new Set(contacts.map(({ other }) => other)).size > 1;
    const decided = isOfParts ? this.inWhole(now, object, contacts.filter(({ touches }) => touches)) : verdict;
    const isOpen = decided === CONTACT.UNRESOLVED;
    return {
      other: this.pack.objects[object], verdict: decided === null ? null : ["conflict", "grazing", "unresolved"][decided], us,
      periods: us.map((period) => period.map((at) => base + at / 1e6)), error_s: Math.max(error, isOpen ? 0 : lackingError),
    };
  }

  // The verdict on contacts with parts of an area that are shallow in each part (whole_areas.py); null: not known.
  inWhole(pieces, object, contacts) {
    const { pack } = this;
    const nth = pack.whole_object?.indexOf(object) ?? -1;
    if (nth < 0 || this.pack.settings[contacts[0].settings].within_us) return null;
    const [from, to] = [0, 1].map((n) => Number(pack.whole_area_offset[nth + n]));
    const [first, last] = [from, to].map((n) => Number(pack.whole_ring_offset[n]));
    const ring = pack.whole_ring.slice(2 * first, 2 * last);
    const area = {
      ring, ringOffset: pack.whole_ring_offset.slice(from, to + 1).map((at) => at - BigInt(first)), areaOffset: BigInt64Array.of(0n, BigInt(to - from)),
      margin: pack.whole_margin.slice(nth, nth + 1),
    };
    const xs = ring.filter((_, n) => n % 2 === 0);
    const middle = (Math.min(...xs) + Math.max(...xs)) / 2;
    // Parts may be copies, a turn away.
    const east = Float64Array.from(contacts, ({ other }) => {
      const corner = 2 * Number(pieces.shape_offset[other]);
      const x = [0, 2, 4].reduce((sum, n) => sum + pieces.shape[corner + n] / 3, 0) + pack.turn_m * pieces.turn[other];
      return pack.turn_m ? pack.turn_m * Math.round((x - middle) / pack.turn_m) : 0;
    });
    const integers = (name) => BigInt64Array.from(contacts, (one) => BigInt(one[name]));
    const numbers = (name) => Float64Array.from(contacts, (one) => (Number.isFinite(one.end) ? one[name] : 0));
    const asked = { a: integers("a"), b: integers("b"), zero: integers("from"), low: numbers("start"), high: numbers("end") };
    const depths = this.kernel.withScene(pieces, null, (scene) => this.kernel.wholeDepths(
      scene, asked, area, new BigInt64Array(contacts.length), Int8Array.from(contacts, ({ other, b }) => Number(other === b)), east));
    return depths.includes(DEPTH.DEEP) ? CONTACT.CONFLICT : depths.includes(DEPTH.UNKNOWN) ? CONTACT.UNRESOLVED : CONTACT.GRAZING;
  }

  // The contacts, or the uses of one place within a time, of pairs under some settings, as `merge` takes them, with `other`.
  contactsOf(now, some, settings) {
    const { within_us: within } = settings;
    const isFirst = ({ mine, other }) => now.object[mine] < now.object[other];
    const met = this.meeting(some, now, now, within).map((pair) => ({ ...pair, ...(isFirst(pair) ? { a: pair.mine, b: pair.other } : { a: pair.other, b: pair.mine }) }));
    // An area is at its place all the time: a wider span leaves an ordinary question.
    const wide = (name, by) => BigInt64Array.from(now[name], (us, row) => (now.moves[row] === 0 ? moved(us, by) : us));
    const lasting = within ? { ...now, start_us: wide("start_us", -within), end_us: wide("end_us", within) } : now;
    const asked = together(lasting, met);
    const high = within ? null : atHeights(this.kernel, lasting, asked);
    const pairs = high ? high.left.map((n) => met[n]) : met;
    const isOfTracks = ({ a, b }) => within > 0 && now.moves[a] !== 0 && now.moves[b] !== 0;
    const cut = pairs.filter(({ isCovered }) => !isCovered);
    const covered = pairs.filter(({ isCovered }) => isCovered).map((pair) => this.undecided(lasting, pair, within));
    const moving = this.contactsDuring(lasting, cut.filter((pair) => !isOfTracks(pair)), pairs, settings);
    if (!within) return [...covered, ...moving];
    const tracks = cut.filter(isOfTracks);
    const [a, b] = ["a", "b"].map((name) => BigInt64Array.from(tracks, (pair) => BigInt(pair[name])));
    const ofTracks = tracks.length ? this.kernel.withScene(now, null, (scene) => this.kernel.uses(scene, now, a, b, settings)) : [];
    const uses = [
      ...covered.map((one) => ({ ...one, known: USE.OF_SPANS })),
      ...moving.map((one) => ({ ...one, known: now.moves[one.a] === 0 ? USE.OF_AREA_A : USE.OF_AREA_B })),
      ...ofTracks.map((use) => ({ ...tracks[use.pair], ...use, known: USE.OF_TRACKS })),
    ].map((use) => ({ ...use, spans: [now.start_us[use.a], now.end_us[use.a], now.start_us[use.b], now.end_us[use.b]] }));
    return this.kernel.useTimes(uses, within).map((use) => {
      const [aFrom, aTo, bFrom, bTo] = use.times;
      return { ...use, from: aFrom < bFrom ? aFrom : bFrom, to: aTo > bTo ? aTo : bTo, start: 0, end: Infinity };
    });
  }

  // A pair about which nothing is known, while both are there and their heights overlap.
  undecided(pieces, pair, within) {
    const asked = together(pieces, [pair]);
    const { low: [start], high: [end] } = within ? asked : atHeights(this.kernel, pieces, asked);
    return { ...pair, from: asked.zero[0], to: asked.to[0], start, end, error: end - start, verdict: CONTACT.UNRESOLVED, touches: true };
  }

  // The contacts of pairs while both are there; all pairs share the work of two objects.
  contactsDuring(pieces, some, all, settings) {
    const asked = atHeights(this.kernel, pieces, together(pieces, some));
    const pairs = asked.left.map((n) => some[n]);
    if (!pairs.length) return [];
    const company = new Map();
    for (const { other } of all) company.set(pieces.object[other], (company.get(pieces.object[other]) ?? 0) + 1);
    const used = new Int8Array(pieces.moves.length);
    for (const { a, b } of pairs) used[a] = used[b] = 1;
    const isLast = (row, to) => pieces.end_us[row] > to || pieces.end_inclusive[row] !== 0;
    const isWhole = ({ a, b }, n) => isLast(a, asked.to[n]) && isLast(b, asked.to[n]);
    return this.kernel.withScene(pieces, used, (scene) => this.kernel.contacts(scene, {
      ...asked, beyond: Float64Array.from(pairs, (pair, n) => (isWhole(pair, n) ? Infinity : Number(asked.to[n] - asked.zero[n]) / 1e6)),
      ofObjects: BigInt64Array.from(pairs, ({ other }) => BigInt(company.get(pieces.object[other]))),
    }, settings)).map(({ pair: n, ...contact }) => (
      { ...pairs[n], from: asked.zero[n], to: asked.to[n], ...contact, error: contact.error + asked.doubt[n] }));
  }
}

// The union of closed intervals of whole numbers.
export function union(spans) {
  const joined = [];
  for (const [low, high] of [...spans].sort((a, b) => a[0] - b[0])) {
    const last = joined[joined.length - 1];
    if (last && low <= last[1] + 1) last[1] = Math.max(last[1], high);
    else joined.push([low, high]);
  }
  return joined;
}
