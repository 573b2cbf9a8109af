// What a track would meet if it departed earlier or later, or went higher or lower: the stages of a detection (conflictdb/stages), on the pieces that
// conflictdb/map/what_if.py packs. Instants are microseconds since the base of the pack.

import { CONTACT, DIFFERENCE } from "./kernel.js";

const TYPES = { i1: Int8Array, u1: Uint8Array, i2: Int16Array, i4: Int32Array, i8: BigInt64Array, f8: Float64Array };
const UNBOUNDED_US = 2 ** 52; // instants of the pack that far away
const BEYOND_US = 10; // differences are asked for this much beyond the horizon
const ROUNDING_US = 0.1; // more than times of pieces are rounded by
const LOOSE_S = 1; // where more stays open between outer and inner interval, times are halved
const MOST_SPLITS = 6;
const ROUNDED_M = 1e6; // heights below are rounded to nanometres, where heights have a margin (separations.py)

// The arrays of a pack, and its head.
export function unpackPieces(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = Object.fromEntries(head.arrays.map(([name, type, at, count]) => [name, new TYPES[type](buffer, 4 + length + at, count)]));
  return { ...head, ...arrays };
}

// The spacing of doubles at a number of 0 or more.
function spacing(x) {
  const bits = new DataView(new ArrayBuffer(8));
  bits.setFloat64(0, x);
  bits.setBigInt64(0, bits.getBigInt64(0) + 1n);
  return bits.getFloat64(0) - x;
}

export const unbounded = (us) => (us <= -UNBOUNDED_US ? -Infinity : us >= UNBOUNDED_US ? Infinity : us);

// The pieces of some rows, as the kernel takes them.
export function taken(pack, rows) {
  const every = (name) => pack[name].constructor.from(rows, (row) => pack[name][row]);
  const twice = (name) => Float64Array.from(rows.flatMap((row) => [pack[name][2 * row], pack[name][2 * row + 1]]));
  const ends = rows.map((row) => [Number(pack.shape_offset[row]), Number(pack.shape_offset[row + 1])]);
  let offset = 0;
  const settings = pack.settings.map((_, n) => n * pack.object.length);
  const ofSettings = (name) => Float64Array.from(settings.flatMap((from) => rows.map((row) => pack[name][from + row])));
  const vertices = (name) => Float64Array.from(ends.flatMap(([from, to]) => [...pack[name].subarray(2 * from, 2 * to)]));
  return {
    plane: pack.plane,
    ...Object.fromEntries(["moves", "turn", "start_us", "end_us", "leg_start_us", "leg_end_us", "bearing_deg",
      "object", "owner", "type", "is_cover", "end_inclusive"].map((name) => [name, every(name)])),
    floor_m: ofSettings("floor_m"), ceiling_m: ofSettings("ceiling_m"),
    leg_start_deg: twice("leg_start_deg"), leg_end_deg: twice("leg_end_deg"),
    shape_offset: BigInt64Array.from([0, ...ends.map(([from, to]) => (offset += to - from))], BigInt),
    shape: vertices("shape"), ...(pack.shape_to && { shape_to: vertices("shape_to") }),
  };
}

// The hulls of a pack, made once.
export function hullsOf(kernel, pack) {
  pack.hulls ??= kernel.hulls(pack, pack.reach_m);
  return pack.hulls;
}

// The box of each hull: [west, south, east, north].
export function boxes({ xy, offset }) {
  return Array.from({ length: offset.length - 1 }, (_, row) => {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let n = Number(offset[row]); n < Number(offset[row + 1]); n += 1) {
      const [x, y] = [xy[2 * n], xy[2 * n + 1]];
      box[0] = Math.min(box[0], x);
      box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x);
      box[3] = Math.max(box[3], y);
    }
    return box;
  });
}

export const overlap = (a, b) => a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];

// The number of the settings of two rows of a pack; -1: they are not compared.
export function settingsOf({ type, of_types: ofTypes, owner }, one, other) {
  return owner[one] !== 0 && owner[one] === owner[other] ? -1 : ofTypes[type[one]][type[other]];
}

// Whether the heights of two rows overlap, as their settings ask for.
function shareHeights({ object, floor_m: floors, ceiling_m: ceilings }, settings, one, other, risen = (m) => m) {
  const from = settings * object.length;
  return risen(floors[from + one]) < ceilings[from + other] && floors[from + other] < risen(ceilings[from + one]);
}

// The values by their settings: [number of the settings, values] each.
function bySettings(values) {
  const found = new Map();
  for (const one of values) found.set(one.settings, [...(found.get(one.settings) ?? []), one]);
  return [...found];
}

// Why pairs of rows of a pack are not compared; null if they are.
function refusalOf(pack, pairs) {
  const rows = [...new Set(pairs.flat())];
  if (rows.some((row) => pack.is_cover[row])) return "one of the objects there could not be cut into pieces";
  const climbs = (row) => pack.climb_m[4 * row] !== pack.climb_m[4 * row + 1] || pack.climb_m[4 * row + 2] !== pack.climb_m[4 * row + 3];
  return pack.climb_m && rows.some(climbs) ? "heights change along a leg there" : null;
}

// Whether a plan has one band of heights, with an end that can be moved.
const hasOneBand = ({ properties }) => (
  [properties.floor_m, properties.ceiling_m].some(Number.isFinite) && !Object.keys(properties).some((name) => ["floors_m", "ceilings_m", "legs"].includes(name)));

export class WhatIf {
  // A track of a pack by its key. `refusal` says why nothing is known, or is null.
  constructor(kernel, pack, key) {
    this.kernel = kernel;
    this.key = key;
    this.refusal = pack.refusal ?? (pack.plans[key] === null ? "its voyages repeat" : pack.objects.includes(key) ? null : "it is never under way");
    if (this.refusal !== null) return;
    this.plan = pack.plans[key];
    this.digest = pack.digests?.[key] ?? null;
    this.pack = pack;
    this.baseUs = BigInt(pack.base_us);
    this.object = pack.objects.indexOf(key);
    const [mine, others] = [[], []];
    pack.object.forEach((object, row) => (object === this.object ? mine : others).push(row));
    const hulls = hullsOf(kernel, pack);
    const box = boxes(hulls);
    const [a, b] = [[], []];
    const whole = mine.reduce((all, row) => [
      Math.min(all[0], box[row][0]), Math.min(all[1], box[row][1]), Math.max(all[2], box[row][2]), Math.max(all[3], box[row][3]),
    ], [Infinity, Infinity, -Infinity, -Infinity]);
    const isNear = (row) => overlap(whole, box[row]) && settingsOf(pack, mine[0], row) >= 0;
    // Pairs in the order of a detection: by the pieces of the earlier object, then of the later one.
    for (const other of others.filter(isNear)) {
      for (const row of mine) {
        if ((pack.turn[row] === 0 || pack.turn[other] === 0) && overlap(box[row], box[other])) {
          a.push(row);
          b.push(other);
        }
      }
    }
    const isApart = kernel.apart(hulls, BigInt64Array.from(a, BigInt), BigInt64Array.from(b, BigInt));
    const near = a.flatMap((row, n) => (isApart[n] ? [] : [[row, b[n]]]));
    const atHeights = near.filter(([row, other]) => shareHeights(pack, settingsOf(pack, row, other), row, other));
    this.refusal = refusalOf(pack, atHeights);
    if (this.refusal !== null) return;
    // At other heights it may meet others.
    this.mayRise = pack.intervals !== "closed" && hasOneBand(this.plan) && refusalOf(pack, near) === null;
    const kept = this.mayRise ? near : atHeights;
    const rows = [...new Set(kept.flat())].sort((one, other) => one - other);
    const place = new Map(rows.map((row, n) => [row, n]));
    this.pieces = taken(pack, rows);
    this.start = Array.from(this.pieces.start_us, (us) => unbounded(Number(us)));
    this.end = Array.from(this.pieces.end_us, (us) => unbounded(Number(us)));
    this.isMine = Array.from(this.pieces.object, (object) => object === this.object);
    this.pairs = kept.map(([row, other]) => ({ mine: place.get(row), other: place.get(other), settings: settingsOf(pack, row, other) }));
  }

  // The lowest floor and the highest ceiling of the objects around, metres.
  get heights() {
    const { floor_m: floors, ceiling_m: ceilings } = this.pieces;
    const known = [...floors, ...ceilings].filter(Number.isFinite);
    return known.length ? [Math.min(...known), Math.max(...known)] : [0, 0];
  }

  // Whether the heights of two pieces overlap if the track is so much higher, metres.
  share({ mine, other, settings }, upM) {
    const risen = (m) => {
      const sum = m + upM;
      return upM !== 0 && this.pack.has_margins && Math.abs(sum) < ROUNDED_M ? Number(sum.toFixed(9)) : sum;
    };
    return shareHeights(this.pieces, settings, mine, other, risen);
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
    const { pieces, start, end } = this;
    const asked = this.pairs.filter((pair) => this.share(pair, upM)).map(({ mine, other, settings }) => {
      const isStill = pieces.moves[other] === 0;
      const [zero, first] = [start[mine], start[other]];
      const last = isStill ? end[other] : first;
      return {
        mine, other, settings, zero, first, last, bZero: isStill ? zero : first, aStart: 0, aEnd: (end[mine] - zero) / 1e6, bStart: 0,
        bEnd: isStill ? 0 : (end[other] - first) / 1e6,
        least: (-(horizonUs + BEYOND_US) - (last - zero)) / 1e6, most: (horizonUs + BEYOND_US - (first - zero)) / 1e6,
      };
    }).filter(({ least, most }) => least <= most);
    const byKey = new Map();
    const solved = bySettings(asked).flatMap(([settings, some]) => this.solved(some, this.pack.settings[settings]));
    for (const { pair, outer: [low, high] } of solved) {
      const key = this.keyOf(pair.other);
      const from = pair.first - pair.zero + Math.floor(1e6 * low - ROUNDING_US);
      const to = pair.last - pair.zero + Math.ceil(1e6 * high + ROUNDING_US);
      if (from > horizonUs || to < -horizonUs) continue;
      if (!byKey.has(key)) byKey.set(key, []);
      byKey.get(key).push([Math.max(from, -horizonUs), Math.min(to, horizonUs)]);
    }
    return new Map([...byKey].map(([key, spans]) => [key, union(spans)]));
  }

  // What brings pairs into contact, of those that something does; several answers where times are halved.
  solved(asked, { separation_m: separation, tolerance_m: tolerance }) {
    const done = [];
    let open = asked;
    this.kernel.withScene(this.pieces, null, (scene) => {
      for (let split = 0; open.length; split += 1) {
        const numbers = (name) => Float64Array.from(open, (pair) => pair[name]);
        const instants = (name) => BigInt64Array.from(open, (pair) => BigInt(pair[name]));
        const found = this.kernel.differences(scene, {
          a: instants("mine"), b: instants("other"), aZero: instants("zero"), bZero: instants("bZero"), aStart: numbers("aStart"),
          aEnd: numbers("aEnd"), bStart: numbers("bStart"), bEnd: numbers("bEnd"), least: numbers("least"), most: numbers("most"),
        }, separation + tolerance);
        const loose = [];
        found.forEach(({ state, outer, inner }, n) => {
          if (state === DIFFERENCE.NONE) return;
          const open_s = outer[1] - outer[0];
          const isKnown = state === DIFFERENCE.UNKNOWN || open_s <= Math.max(0, inner[1] - inner[0]) + LOOSE_S || split === MOST_SPLITS;
          if (isKnown) done.push({ pair: open[n], outer });
          else loose.push(open[n]);
        });
        open = loose.flatMap(halved);
      }
    });
    return done;
  }

  // The conflicts of the track if it departs so much later, microseconds, and is so much higher, metres: in the order of the other objects, with their
  // periods in Unix seconds, and as `us` in microseconds since the base. A verdict of null: conflict or grazing.
  conflicts(laterUs, upM = 0) {
    const { pieces, pack } = this;
    const mineIs = (row, by) => (this.isMine[row] ? by : 0);
    const starts = this.start.map((us, row) => us + mineIs(row, laterUs));
    const ends = this.end.map((us, row) => us + mineIs(row, laterUs));
    const isLast = (row, end) => ends[row] > end || pieces.end_inclusive[row] !== 0;
    const together = this.pairs.flatMap((pair) => {
      const { mine, other, settings } = pair;
      if (!this.share(pair, upM)) return [];
      const [from, to] = [Math.max(starts[mine], starts[other]), Math.min(ends[mine], ends[other])];
      const hasEnd = isLast(mine, to) && isLast(other, to);
      if (!(from < to || (from === to && hasEnd))) return [];
      const isFirst = pieces.object[mine] < pieces.object[other];
      return [{ other, settings, a: isFirst ? mine : other, b: isFirst ? other : mine, from, to, hasEnd }];
    });
    if (!together.length) return [];
    const company = new Map();
    for (const { other } of together) company.set(pieces.object[other], (company.get(pieces.object[other]) ?? 0) + 1);
    const moved = (name) => BigInt64Array.from(pieces[name], (us, row) => us + BigInt(mineIs(row, laterUs)));
    const now = { ...pieces, ...Object.fromEntries(["start_us", "end_us", "leg_start_us", "leg_end_us"].map((name) => [name, moved(name)])) };
    const used = new Int8Array(pieces.moves.length);
    for (const { a, b } of together) used[a] = used[b] = 1;
    const span = ({ from, to }) => (to - from) / 1e6;
    const found = this.kernel.withScene(now, used, (scene) => bySettings(together).flatMap(([settings, some]) => {
      const integers = (of) => BigInt64Array.from(some, (pair) => BigInt(of(pair)));
      const seconds = (of) => Float64Array.from(some, of);
      const contacts = this.kernel.contacts(scene, {
        a: integers(({ a }) => a), b: integers(({ b }) => b), zero: integers(({ from }) => from),
        low: seconds(() => 0), high: seconds(span), beyond: seconds((pair) => (pair.hasEnd ? Infinity : span(pair))),
        ofObjects: integers(({ other }) => company.get(pieces.object[other])),
      }, pack.settings[settings]);
      return contacts.map((contact) => ({ ...contact, of: some[contact.pair] }));
    }));
    const byObject = new Map();
    for (const contact of found) {
      const { other, from, to } = contact.of;
      const [start, end] = instants(contact, from, to);
      if (!byObject.has(pieces.object[other])) byObject.set(pieces.object[other], []);
      byObject.get(pieces.object[other]).push({ ...contact, start, end, lasts: contact.end - contact.start, other });
    }
    return [...byObject].sort(([a], [b]) => a - b).map(([object, contacts]) => this.merged(object, contacts));
  }

  // One conflict of the contacts of two objects, as conflictdb/stages/merge.py merges them.
  merged(object, contacts) {
    const doMeet = contacts.some(({ touches }) => touches);
    const told = contacts.filter(({ touches, verdict }) => touches || !doMeet || verdict === CONTACT.UNRESOLVED)
      .sort((a, b) => a.start - b.start || a.end - b.end);
    const periods = [];
    for (const contact of told) {
      const last = periods[periods.length - 1];
      if (last && contact.start <= last.end) {
        last.end = Math.max(last.end, contact.end);
        last.contacts.push(contact);
      } else {
        periods.push({ start: contact.start, end: contact.end, contacts: [contact] });
      }
    }
    const parts = new Set(contacts.map(({ other }) => other)).size;
    const isOfParts = doMeet && parts > 1 && this.pieces.moves[contacts[0].other] === 0;
    const verdict = told.some((one) => one.verdict === CONTACT.CONFLICT) ? "conflict"
      : told.some((one) => one.verdict === CONTACT.UNRESOLVED) ? "unresolved" : isOfParts ? null : "grazing";
    const base = Number(this.baseUs) / 1e6;
    return {
      other: this.pack.objects[object], verdict, us: periods.map(({ start, end }) => [start, end]),
      periods: periods.map(({ start, end }) => [base + start / 1e6, base + end / 1e6]), error_s: Math.max(...periods.map(errorOf)),
    };
  }
}

// The ends of a contact as instants, rounded outward to the microsecond within the span that a pair shares.
function instants({ start, end }, from, to) {
  const since = start <= 0 ? from : from + Math.floor((start - 2 * spacing(start)) * 1e6);
  const until = end >= (to - from) / 1e6 ? to : Math.min(from + Math.ceil((end + 2 * spacing(end)) * 1e6), to);
  return [Math.max(since, from), until];
}

// How much longer than the contact a period may be at either end, seconds.
function errorOf({ start, end, contacts }) {
  const length = (end - start) / 1e6;
  const sure = contacts.filter((one) => (one.end - one.start) / 1e6 > 2 * one.error || contacts.length === 1);
  const least = (of) => Math.min(Infinity, ...sure.map((one) => of(one) / 1e6 + one.error));
  return Math.min(Math.max(least((one) => one.start - start), least((one) => end - one.end)), length);
}

// The two halves of the longer time of a pair.
function halved(pair) {
  const name = pair.aEnd - pair.aStart >= pair.bEnd - pair.bStart ? "a" : "b";
  const middle = (pair[`${name}Start`] + pair[`${name}End`]) / 2;
  return [{ ...pair, [`${name}End`]: middle }, { ...pair, [`${name}Start`]: middle }];
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
