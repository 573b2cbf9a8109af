// Pieces of a scene (conflictdb/map/what_if.py packs them), and which of them may meet an object's: stages 1 and 2 by the kernel. Instants
// are microseconds since the base of the pack.

import { NEVER_BEGAN, NEVER_ENDS } from "./kernel.js";

const TYPES = { i1: Int8Array, u1: Uint8Array, i2: Int16Array, i4: Int32Array, i8: BigInt64Array, f8: Float64Array };
const UNBOUNDED_US = 2n ** 52n; // instants of the pack that far away
const INSTANTS = ["start_us", "end_us", "leg_start_us", "leg_end_us"];

// The arrays of a pack, and its head.
export function unpackPieces(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = Object.fromEntries(head.arrays.map(([name, type, at, count]) => [name, new TYPES[type](buffer, 4 + length + at, count)]));
  for (const name of ["start_us", "end_us"]) {
    arrays[name]?.forEach((us, row) => {
      if (us <= -UNBOUNDED_US) arrays[name][row] = NEVER_BEGAN;
      if (us >= UNBOUNDED_US) arrays[name][row] = NEVER_ENDS;
    });
  }
  return { ...head, ...arrays };
}

// A pack that asks for a margin { s, m }, seconds and metres, on top of all separations (conflictdb/model/margin.py).
export function withMargin(pack, { s, m }) {
  if (m > pack.margin_m) throw new Error("the separations of the scene are too large for this margin");
  const settings = pack.settings.map((one) => ({ ...one, separation_m: one.separation_m + m, within_us: one.within_us + 1e6 * s }));
  return { ...pack, settings, reach_m: pack.reach_m + m, hulls: null, columns: null };
}

// An instant as a number; infinite where there is none.
export const unbounded = (us) => (us === NEVER_BEGAN ? -Infinity : us === NEVER_ENDS ? Infinity : Number(us));

// The pieces of some rows, as the kernel takes them; heights of all settings one after the other.
export function taken(pack, rows) {
  const every = (name) => pack[name].constructor.from(rows, (row) => pack[name][row]);
  const several = (name, each) => pack[name].constructor.from(rows.flatMap((row) => [...pack[name].subarray(each * row, each * row + each)]));
  const ends = rows.map((row) => [Number(pack.shape_offset[row]), Number(pack.shape_offset[row + 1])]);
  let offset = 0;
  const settings = pack.settings.map((_, n) => n * pack.object.length);
  const ofSettings = (name) => Float64Array.from(settings.flatMap((from) => rows.map((row) => pack[name][from + row])));
  const climb = () => Float64Array.from(settings.flatMap((from) => rows.flatMap((row) => [...pack.climb_m.subarray(4 * (from + row), 4 * (from + row) + 4)])));
  const vertices = (name) => Float64Array.from(ends.flatMap(([from, to]) => [...pack[name].subarray(2 * from, 2 * to)]));
  return {
    plane: pack.plane,
    ...Object.fromEntries(["moves", "turn", ...INSTANTS, "bearing_deg", "object", "type", "is_cover", "end_inclusive"].map((name) => [name, every(name)])),
    floor_m: ofSettings("floor_m"), ceiling_m: ofSettings("ceiling_m"), ...(pack.climb_m && { climb_m: climb() }),
    numbers: several("numbers", pack.numbers.length / pack.object.length), leg_start_deg: several("leg_start_deg", 2), leg_end_deg: several("leg_end_deg", 2),
    shape_offset: BigInt64Array.from([0, ...ends.map(([from, to]) => (offset += to - from))], BigInt),
    shape: vertices("shape"), ...(pack.shape_to && { shape_to: vertices("shape_to") }),
  };
}

// The same pieces, those of an object (by its number) so much later.
export function later(pieces, object, us) {
  const moved = (name) => BigInt64Array.from(pieces[name], (at, row) => (pieces.object[row] === object ? at + BigInt(us) : at));
  return { ...pieces, ...Object.fromEntries(INSTANTS.map((name) => [name, moved(name)])) };
}

// The heights of pieces under some settings: { climb_m, floor_m, ceiling_m }.
export function heightsUnder(pieces, settings) {
  const n = pieces.object.length;
  const [from, to] = [settings * n, (settings + 1) * n];
  const { floor_m: floor, ceiling_m: ceiling, climb_m: climb } = pieces;
  return { floor_m: floor.subarray(from, to), ceiling_m: ceiling.subarray(from, to), climb_m: climb?.subarray(4 * from, 4 * to) ?? null };
}

// The hulls of a pack, padded for the separation, made once.
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

// The columns of KernelBoxes of pieces; boxes, heights and times as they are given, or null: not compared.
export function rowsOf({ object, turn, end_inclusive: inclusive, numbers, type }, { boxes: box = null, heights = null, times = null }, isNumbered = true) {
  const n = object.length;
  const all = (value) => new Float64Array(n).fill(value);
  return [
    box, heights?.floor_m ?? all(-Infinity), heights?.ceiling_m ?? all(Infinity), times?.start_us ?? new BigInt64Array(n), times?.end_us ?? new BigInt64Array(n),
    BigInt64Array.from(object, BigInt), Uint8Array.from(turn, (one) => one !== 0), times ? Uint8Array.from(inclusive) : null,
    isNumbered ? numbers : null, BigInt64Array.from(type, BigInt),
  ];
}

// Which pairs of rows of pieces may meet, as flags.
export function mayMeet(kernel, rows, pairs, within = 0) {
  const [a, b] = [0, 1].map((n) => BigInt64Array.from(pairs, (pair) => BigInt(pair[n])));
  return kernel.mayMeet(rows, rows, { within: BigInt(within) }, a, b);
}

// The columns of KernelBoxes of a pack within a reach, with what could not be cut everywhere.
function columnsOf(pack, hulls, how, isNumbered) {
  const everywhere = [-Infinity, -Infinity, Infinity, Infinity];
  const box = new Float64Array(4 * pack.object.length);
  boxes(hulls).forEach((own, row) => box.set(pack.is_cover[row] ? everywhere : own, 4 * row));
  return rowsOf(pack, { boxes: box, ...how }, isNumbered);
}

// Pairs of rows of a pack, { mine (of an object), other, isCovered }, that may meet; also what could not be cut, which may be anywhere.
//   reachM: within this, metres; `isTimed`: at the times, and `heights`: at these heights, else at any; `isAllowed`: also what is not compared.
export function pairsNear(kernel, pack, object, { reachM = pack.reach_m, isTimed = false, heights = null, isAllowed = false } = {}) {
  const hulls = reachM === pack.reach_m ? hullsOf(kernel, pack) : kernel.hulls(pack, reachM);
  const isUsual = reachM === pack.reach_m && !isTimed && heights === null && !isAllowed;
  const made = (isUsual && pack.columns) || columnsOf(pack, hulls, { heights, times: isTimed ? pack : null }, !isAllowed);
  if (isUsual) pack.columns = made;
  // Objects of larger numbers are found.
  const numbers = new BigInt64Array(pack.object.length).fill(1n);
  const mine = [...pack.object.keys()].filter((row) => pack.object[row] === object);
  for (const row of mine) numbers[row] = 0n;
  const rows = [...made.slice(0, 5), numbers, ...made.slice(6)];
  const types = { types: BigInt(pack.of_types.length), compared: Uint8Array.from(pack.of_types.flat(), (settings) => settings >= 0) };
  const near = kernel.boxPairs(rows, isAllowed ? {} : types, BigInt64Array.from(mine, BigInt));
  const isCovered = ([row, other]) => Boolean(pack.is_cover[row] || pack.is_cover[other]);
  const isApart = kernel.apart(hulls, ...[0, 1].map((n) => BigInt64Array.from(near, (pair) => BigInt(pair[n]))));
  // In the order of the other objects.
  return near.filter((pair, n) => isCovered(pair) || !isApart[n]).sort((one, two) => one[1] - two[1] || one[0] - two[0])
    .map((pair) => ({ mine: pair[0], other: pair[1], isCovered: isCovered(pair) }));
}

// Pairs whose rows are those of the pieces that they have, and these pieces.
export function alone(pack, pairs) {
  const rows = [...new Set(pairs.flatMap(({ mine, other }) => [mine, other]))].sort((one, other) => one - other);
  const place = new Map(rows.map((row, n) => [row, n]));
  return { pieces: taken(pack, rows), pairs: pairs.map((pair) => ({ ...pair, mine: place.get(pair.mine), other: place.get(pair.other) })) };
}

// Pairs { a, b } as the kernel takes them, during the time that both share: { a, b, zero, low, high }, and the ends of that time.
export function together({ start_us: start, end_us: end, moves }, pairs) {
  const from = BigInt64Array.from(pairs, ({ a, b }) => (start[a] > start[b] ? start[a] : start[b]));
  const to = BigInt64Array.from(pairs, ({ a, b }) => (end[a] < end[b] ? end[a] : end[b]));
  const isStill = ({ a, b }) => moves[a] === 0 && moves[b] === 0;
  return {
    a: BigInt64Array.from(pairs, ({ a }) => BigInt(a)), b: BigInt64Array.from(pairs, ({ b }) => BigInt(b)), zero: from, to,
    low: new Float64Array(pairs.length), high: Float64Array.from(pairs, (pair, n) => (isStill(pair) ? 0 : Number(to[n] - from[n]) / 1e6)),
  };
}

// Pairs with their times cut to when their heights overlap; those that never do are left out.
export function atHeights(kernel, pieces, asked) {
  const overlaps = kernel.heightOverlaps(pieces, asked.a, asked.b);
  const low = Float64Array.from(overlaps, ({ first }) => Math.max(0, first));
  const high = Float64Array.from(overlaps, ({ last }, n) => Math.min(asked.high[n], last));
  const left = [...overlaps.keys()].filter((n) => low[n] <= high[n]);
  const some = (values) => values.constructor.from(left, (n) => values[n]);
  return {
    left, a: some(asked.a), b: some(asked.b), zero: some(asked.zero), to: some(asked.to), low: some(low), high: some(high),
    doubt: Float64Array.from(left, (n) => overlaps[n].error),
  };
}
