// What a track would meet if it departed earlier or later, or went higher or lower: the stages of a detection (conflictdb/core), on the pieces that
// conflictdb/map/what_if.py packs. Instants are microseconds since the base of the pack.

import { overlapAtOneTime } from "./climbs.js";
import { CONTACT } from "./kernel.js";
import { atHeights, ROUNDING_US, solved } from "./shifts.js";
import { asContact, nearInTime, useOfArea, usesOfTracks } from "./uses.js";

const TYPES = { i1: Int8Array, u1: Uint8Array, i2: Int16Array, i4: Int32Array, i8: BigInt64Array, f8: Float64Array };
const UNBOUNDED_US = 2 ** 52; // instants of the pack that far away
const BEYOND_US = 10; // differences are asked for this much beyond the horizon
const ROUNDED_M = 1e6; // heights below are rounded to nanometres, where heights have a margin (separations.py)

// The arrays of a pack, and its head.
export function unpackPieces(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = Object.fromEntries(head.arrays.map(([name, type, at, count]) => [name, new TYPES[type](buffer, 4 + length + at, count)]));
  return { ...head, ...arrays };
}

// The next double above a finite number, or so many further.
function beyond(x, steps = 1n) {
  const bits = new DataView(new ArrayBuffer(8));
  bits.setFloat64(0, x === 0 ? 0 : x);
  if (x < 0 || (x === 0 && steps < 0n)) return -beyond(-x, -steps);
  bits.setBigInt64(0, bits.getBigInt64(0) + steps);
  return bits.getFloat64(0);
}

// The spacing of doubles at a number of 0 or more.
const spacing = (x) => beyond(x) - x;

export const unbounded = (us) => (us <= -UNBOUNDED_US ? -Infinity : us >= UNBOUNDED_US ? Infinity : us);

// The pieces of some rows, as the kernel takes them.
export function taken(pack, rows) {
  const every = (name) => pack[name].constructor.from(rows, (row) => pack[name][row]);
  const twice = (name) => Float64Array.from(rows.flatMap((row) => [pack[name][2 * row], pack[name][2 * row + 1]]));
  const ends = rows.map((row) => [Number(pack.shape_offset[row]), Number(pack.shape_offset[row + 1])]);
  let offset = 0;
  const settings = pack.settings.map((_, n) => n * pack.object.length);
  const ofSettings = (name) => Float64Array.from(settings.flatMap((from) => rows.map((row) => pack[name][from + row])));
  const climb = () => Float64Array.from(settings.flatMap((from) => rows.flatMap((row) => [...pack.climb_m.subarray(4 * (from + row), 4 * (from + row) + 4)])));
  const vertices = (name) => Float64Array.from(ends.flatMap(([from, to]) => [...pack[name].subarray(2 * from, 2 * to)]));
  return {
    plane: pack.plane,
    ...Object.fromEntries(["moves", "turn", "start_us", "end_us", "leg_start_us", "leg_end_us", "bearing_deg",
      "object", "owner", "type", "is_cover", "end_inclusive"].map((name) => [name, every(name)])),
    floor_m: ofSettings("floor_m"), ceiling_m: ofSettings("ceiling_m"), ...(pack.climb_m && { climb_m: climb() }),
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

// The values by their settings: [number of the settings, values] each.
function bySettings(values) {
  const found = new Map();
  for (const one of values) found.set(one.settings, [...(found.get(one.settings) ?? []), one]);
  return [...found];
}

// The floors and ceilings of a plan that are known, metres.
export const limitsOf = ({ properties }) => [properties.floor_m, properties.ceiling_m].flat().filter(Number.isFinite);

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
    const [mine, others] = [[], []];
    pack.object.forEach((object, row) => (object === this.object ? mine : others).push(row));
    const hulls = hullsOf(kernel, pack);
    const box = boxes(hulls);
    const [a, b] = [[], []];
    const whole = mine.reduce((all, row) => [
      Math.min(all[0], box[row][0]), Math.min(all[1], box[row][1]), Math.max(all[2], box[row][2]), Math.max(all[3], box[row][3]),
    ], [Infinity, Infinity, -Infinity, -Infinity]);
    // What could not be cut may be anywhere.
    const isCovered = (row, other) => pack.is_cover[row] || pack.is_cover[other];
    const isNear = (row) => (isCovered(mine[0], row) || overlap(whole, box[row])) && settingsOf(pack, mine[0], row) >= 0;
    // Pairs in the order of a detection: by the pieces of the earlier object, then of the later one.
    for (const other of others.filter(isNear)) {
      for (const row of mine) {
        if ((pack.turn[row] === 0 || pack.turn[other] === 0) && (isCovered(row, other) || overlap(box[row], box[other]))) {
          a.push(row);
          b.push(other);
        }
      }
    }
    const isApart = kernel.apart(hulls, BigInt64Array.from(a, BigInt), BigInt64Array.from(b, BigInt));
    const near = a.flatMap((row, n) => (isApart[n] && !isCovered(row, b[n]) ? [] : [[row, b[n]]]));
    this.mayRise = limitsOf(this.plan).length > 0;
    const rows = [...new Set(near.flat())].sort((one, other) => one - other);
    const place = new Map(rows.map((row, n) => [row, n]));
    this.pieces = taken(pack, rows);
    this.start = Array.from(this.pieces.start_us, (us) => unbounded(Number(us)));
    this.end = Array.from(this.pieces.end_us, (us) => unbounded(Number(us)));
    this.isMine = Array.from(this.pieces.object, (object) => object === this.object);
    const pairs = near.map(([row, other]) => (
      { mine: place.get(row), other: place.get(other), settings: settingsOf(pack, row, other), isCovered: Boolean(isCovered(row, other)) }));
    // At other heights it may meet others.
    this.pairs = this.mayRise ? pairs : pairs.filter((pair) => this.share(pair, 0));
  }

  // The lowest floor and the highest ceiling of the objects around, metres.
  get heights() {
    const { floor_m: floors, ceiling_m: ceilings } = this.pieces;
    const known = [...floors, ...ceilings].filter(Number.isFinite);
    return known.length ? [Math.min(...known), Math.max(...known)] : [0, 0];
  }

  // Whether the heights of two pieces overlap if the track is so much higher, metres.
  share({ mine, other, settings }, upM) {
    const [[floor, ceiling], [low, high]] = [this.band(mine, settings, upM), this.band(other, settings, upM)];
    return floor < high && low < ceiling;
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

  // The floor and the ceiling of a piece; and its heights at the start and the end of its leg, as climbs.js has them.
  band(row, settings, upM) {
    const at = settings * this.pieces.object.length + row;
    const band = [this.pieces.floor_m[at], this.pieces.ceiling_m[at]];
    return this.isMine[row] ? band.map((m, n) => this.risen(m, upM, n === 1)) : band;
  }

  heightsOf(row, settings, upM) {
    if (!this.pieces.climb_m) {
      const [floor, ceiling] = this.band(row, settings, upM);
      return [floor, floor, ceiling, ceiling];
    }
    const at = 4 * (settings * this.pieces.object.length + row);
    const heights = [...this.pieces.climb_m.subarray(at, at + 4)];
    return this.isMine[row] ? heights.map((m, n) => this.risen(m, upM, n > 1)) : heights;
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
    for (const [settings, some] of bySettings(this.pairs.filter((pair) => this.share(pair, upM)))) {
      const { separation_m: separation, tolerance_m: tolerance, within_us: within } = this.pack.settings[settings];
      for (const { mine, other } of some.filter(({ isCovered }) => isCovered)) {
        forbid(other, this.start[other] - this.end[mine] - within, this.end[other] - this.start[mine] + within);
      }
      const shifts = some.filter(({ isCovered }) => !isCovered).map((pair) => this.shiftOf(pair, horizonUs + BEYOND_US + within, upM)).filter(Boolean);
      const found = this.kernel.withScene(this.pieces, null, (scene) => solved(this.kernel, scene, shifts, separation + tolerance));
      for (const { of: { b, zero, first, last }, outer: [low, high] } of found) {
        forbid(b, first - zero + Math.floor(1e6 * low - ROUNDING_US) - within, last - zero + Math.ceil(1e6 * high + ROUNDING_US) + within);
      }
    }
    return new Map([...byKey].map(([key, spans]) => [key, union(spans)]));
  }

  // A pair as a shift of the track by at most so many microseconds; null: their heights never overlap.
  shiftOf({ mine, other, settings }, mostUs, upM) {
    const { pieces, start, end } = this;
    const isStill = pieces.moves[other] === 0;
    const [zero, first] = [start[mine], start[other]];
    const last = isStill ? end[other] : first;
    const shift = {
      a: mine, b: other, aZero: zero, bZero: isStill ? zero : first, zero, first, last, aStart: 0, aEnd: (end[mine] - zero) / 1e6,
      bStart: 0, bEnd: isStill ? 0 : (end[other] - first) / 1e6,
      least: (-mostUs - (last - zero)) / 1e6, most: (mostUs - (first - zero)) / 1e6,
    };
    const leg = (row) => [Number(pieces.leg_start_us[row]), Number(pieces.leg_end_us[row])];
    return shift.least <= shift.most ? atHeights(shift, (row) => this.heightsOf(row, settings, upM), (row) => this.band(row, settings, upM), leg) : null;
  }

  // The conflicts of the track if it departs so much later, microseconds, and is so much higher, metres: in the order of the other objects, with their
  // periods in Unix seconds, and as `us` in microseconds since the base. A verdict of null: conflict or grazing.
  conflicts(laterUs, upM = 0) {
    const { pieces } = this;
    const by = (row) => (this.isMine[row] ? laterUs : 0);
    const moved = (name) => BigInt64Array.from(pieces[name], (us, row) => us + BigInt(by(row)));
    const now = {
      pieces: { ...pieces, ...Object.fromEntries(["start_us", "end_us", "leg_start_us", "leg_end_us"].map((name) => [name, moved(name)])) },
      span: (row) => [this.start[row] + by(row), this.end[row] + by(row)],
    };
    now.leg = (row) => [Number(now.pieces.leg_start_us[row]), Number(now.pieces.leg_end_us[row])];
    const found = bySettings(this.pairs.filter((pair) => this.share(pair, upM)))
      .flatMap(([settings, some]) => this.contactsOf(now, some, settings, upM));
    const byObject = new Map();
    for (const contact of found) {
      const object = pieces.object[contact.other];
      if (!byObject.has(object)) byObject.set(object, []);
      byObject.get(object).push(contact);
    }
    return [...byObject].sort(([a], [b]) => a - b).map(([object, contacts]) => this.merged(object, contacts));
  }

  // The contacts, or the uses of one place within a time, of pairs of some settings: { other, start, end (microseconds), error
  // (seconds), verdict, touches, lacking, lackingError }.
  contactsOf(now, some, settings, upM) {
    const { pieces } = now;
    const { within_us: within } = this.pack.settings[settings];
    const heights = (row) => this.heightsOf(row, settings, upM);
    const pairs = some.flatMap((pair) => {
      const { mine, other } = pair;
      const spans = [now.span(mine), now.span(other)];
      const [from, to] = [Math.max(spans[0][0], spans[1][0]), Math.min(spans[0][1], spans[1][1])];
      const isLast = (row, [, end]) => end > to || pieces.end_inclusive[row] !== 0;
      const isTogether = from < to + within || (from === to + within && isLast(mine, spans[0]) && isLast(other, spans[1]));
      if (!isTogether) return [];
      const isFirst = pieces.object[mine] < pieces.object[other];
      return [{ ...pair, a: isFirst ? mine : other, b: isFirst ? other : mine }];
    });
    const near = ({ a, b }) => nearInTime(now.span(a), now.span(b), within);
    const covered = pairs.filter(({ isCovered }) => isCovered).flatMap((pair) => {
      const { a: [start, until], b: [start2, until2] } = near(pair);
      const [from, to] = [Math.min(start, start2), Math.max(until, until2)];
      const { first, last } = within ? { first: 0, last: Infinity } : this.heightsTogether(now, pair, now.span, heights);
      if (first > last) return [];
      const [begins, ends] = [from + Math.floor(1e6 * Math.max(0, first)), Math.min(to, from + Math.ceil(1e6 * last))];
      return [{ ...pair, start: begins, end: ends, error: (ends - begins) / 1e6, verdict: CONTACT.UNRESOLVED, touches: true, lacking: NaN, lackingError: NaN }];
    });
    const isOfTracks = ({ a, b }) => within > 0 && pieces.moves[a] !== 0 && pieces.moves[b] !== 0;
    const cut = pairs.filter(({ isCovered }) => !isCovered);
    // An area is at its place all the time: a wider span leaves an ordinary question.
    const span = (row) => now.span(row).map((us, n) => us + (pieces.moves[row] === 0 ? [-within, within][n] : 0));
    const contacts = this.contactsDuring(now, cut.filter((pair) => !isOfTracks(pair)), this.pack.settings[settings], span, heights);
    const met = within === 0 ? contacts : contacts.map((contact) => {
      const area = pieces.moves[contact.other] === 0 ? contact.other : contact.mine;
      return asContact(useOfArea(contact, now.span(area), within), near(contact));
    });
    const uses = usesOfTracks(this.kernel, cut.filter(isOfTracks), this.pack.settings[settings], {
      span: now.span, leg: now.leg, heights, band: (row) => this.band(row, settings, upM),
      sceneOf: (rows, by, ask) => {
        const own = taken({ ...pieces, settings: this.pack.settings }, rows);
        const names = by === null ? [] : ["start_us", "end_us", "leg_start_us", "leg_end_us"];
        for (const name of names) own[name].forEach((us, n) => { own[name][n] = us - BigInt(by[n]); });
        return this.kernel.withScene(own, null, ask);
      },
    });
    return [...covered, ...met, ...uses.map(({ pair, ...use }) => ({ ...use, other: pair.other }))];
  }

  // When the heights of a pair overlap during the time that both share, by some spans of theirs (climbs.js).
  heightsTogether(now, { a, b }, span, heights) {
    const [from, to] = [Math.max(span(a)[0], span(b)[0]), Math.min(span(a)[1], span(b)[1])];
    const shares = (row) => {
      const [start, end] = now.leg(row);
      return [from, to].map((us) => (us - start) / Math.max(end - start, 1));
    };
    return overlapAtOneTime(heights(a), heights(b), shares(a), shares(b), (to - from) / 1e6);
  }

  // The contacts of pairs while both are there, by some spans.
  contactsDuring(now, pairs, settings, span, heights) {
    const { pieces } = now;
    const asked = pairs.flatMap((pair) => {
      const { a, b } = pair;
      const [from, to] = [Math.max(span(a)[0], span(b)[0]), Math.min(span(a)[1], span(b)[1])];
      const length = (to - from) / 1e6;
      const time = this.heightsTogether(now, pair, span, heights);
      const [low, high] = [Math.max(0, time.first), Math.min(length, time.last)];
      if (low > high) return [];
      const isLast = (row) => span(row)[1] > to || pieces.end_inclusive[row] !== 0;
      return [{ ...pair, from, to, low, high, doubt: time.error, beyond: isLast(a) && isLast(b) ? Infinity : length }];
    });
    if (!asked.length) return [];
    const company = new Map();
    for (const { other } of pairs) company.set(pieces.object[other], (company.get(pieces.object[other]) ?? 0) + 1);
    const used = new Int8Array(pieces.moves.length);
    for (const { a, b } of asked) used[a] = used[b] = 1;
    const integers = (of) => BigInt64Array.from(asked, (pair) => BigInt(of(pair)));
    const numbers = (of) => Float64Array.from(asked, of);
    const found = this.kernel.withScene(pieces, used, (scene) => this.kernel.contacts(scene, {
      a: integers(({ a }) => a), b: integers(({ b }) => b), zero: integers(({ from }) => from),
      low: numbers(({ low }) => low), high: numbers(({ high }) => high), beyond: numbers(({ beyond: at }) => at),
      ofObjects: integers(({ other }) => company.get(pieces.object[other])),
    }, settings));
    return found.map((contact) => {
      const { from, to, doubt, ...pair } = asked[contact.pair];
      const [start, end] = instants(contact, from, to);
      return { ...pair, start, end, error: contact.error + doubt, verdict: contact.verdict, touches: contact.touches, lacking: NaN, lackingError: NaN };
    });
  }

  // One conflict of the contacts of two objects, as conflictdb/core/merge.py merges them.
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
      periods: periods.map(({ start, end }) => [base + start / 1e6, base + end / 1e6]),
      error_s: Math.max(...periods.map(errorOf), verdict === "unresolved" ? 0 : lackingErrorOf(told)),
    };
  }
}

// The ends of a contact as instants, rounded outward to the microsecond within the span that a pair shares.
function instants({ start, end }, from, to) {
  const since = start <= 0 ? from : from + Math.floor((start - 2 * spacing(start)) * 1e6);
  const until = end >= (to - from) / 1e6 ? to : Math.min(from + Math.ceil((end + 2 * spacing(end)) * 1e6), to);
  return [Math.max(since, from), until];
}

// How much less of the separation in time may be lacking than uses say, seconds.
function lackingErrorOf(uses) {
  const known = uses.filter(({ lacking }) => !Number.isNaN(lacking));
  const most = Math.max(0, ...known.map(({ lacking }) => lacking));
  return most - Math.min(most, Math.max(0, ...known.map(({ lacking, lackingError }) => lacking - lackingError)));
}

// How much longer than the contact a period may be at either end, seconds.
function errorOf({ start, end, contacts }) {
  const length = (end - start) / 1e6;
  const sure = contacts.filter((one) => (one.end - one.start) / 1e6 > 2 * one.error || contacts.length === 1);
  const least = (of) => Math.min(Infinity, ...sure.map((one) => of(one) / 1e6 + one.error));
  return Math.min(Math.max(least((one) => one.start - start), least((one) => end - one.end)), length);
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
