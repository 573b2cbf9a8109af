// The kernel of detections as WebAssembly (kernel.wasm): structures as kernel.h has them, with pointers of 32 bits.

const ABI = 27; // KERNEL_ABI that the structures below are of
const OK = 0;
const PART_BYTES = 112; // KernelDifferencePart
const CONTACT_BYTES = 40; // KernelContact
const USE_BYTES = 88; // KernelUse
const WORK_BYTES = 56; // KernelWork
const HULL_PER_VERTEX = 6;
const HULL_MORE = 5;

// Instants of spans without a beginning or an end.
export const NEVER_BEGAN = -(2n ** 63n);
export const NEVER_ENDS = 2n ** 63n - 1n;
// What is known of a use of one place.
export const USE = { OF_SPANS: 0, OF_AREA_A: 1, OF_AREA_B: 2, OF_TRACKS: 3 };
export const DEPTH = { SHALLOW: 0, DEEP: 1, UNKNOWN: 2 };
export const CONTACT = { CONFLICT: 0, GRAZING: 1, UNRESOLVED: 2 };

export class Kernel {
  // From the bytes of kernel.wasm.
  static async of(bytes) {
    // Its clock stands still: the page shows no seconds of work.
    const clock = (_, __, at) => { new DataView(instance.exports.memory.buffer).setBigInt64(at, 0n, true); return 0; };
    const { instance } = await WebAssembly.instantiate(bytes, { wasi_snapshot_preview1: { clock_time_get: clock } });
    instance.exports._initialize?.();
    const abi = instance.exports.kernel_abi();
    if (abi !== ABI) throw new Error(`kernel.wasm has ABI ${abi}, this page ${ABI}: install conflictdb again`);
    return new Kernel(instance.exports);
  }

  constructor(functions) {
    this.functions = functions;
    this.held = []; // of the call that is made
  }

  // Calls `make` with memory that is freed after.
  call(make) {
    const before = this.held;
    this.held = [];
    try {
      return make();
    } finally {
      for (const at of this.held) this.functions.free(at);
      this.held = before;
    }
  }

  room(bytes) {
    const at = this.functions.malloc(Math.max(8, bytes));
    if (at === 0) throw new Error("the kernel is out of memory");
    this.held.push(at);
    return at;
  }

  // Copies a typed array; null is NULL.
  put(values) {
    if (values === null) return 0;
    const at = this.room(values.byteLength);
    new Uint8Array(this.functions.memory.buffer, at, values.byteLength).set(
      new Uint8Array(values.buffer, values.byteOffset, values.byteLength));
    return at;
  }

  // Makes a structure of BigInts (64 bits), numbers (doubles), and typed arrays, places { at } or null (pointers).
  struct(...fields) {
    const pointers = fields.map((field) => (field?.at !== undefined && !ArrayBuffer.isView(field) ? field.at
      : ArrayBuffer.isView(field) || field === null ? this.put(field) : null));
    const at = this.room(8 * fields.length);
    const view = new DataView(this.functions.memory.buffer);
    let next = at;
    fields.forEach((field, n) => {
      const isPointer = pointers[n] !== null;
      if (!isPointer) next += -next & 7;
      if (isPointer) view.setUint32(next, pointers[n], true);
      else if (typeof field === "bigint") view.setBigInt64(next, field, true);
      else view.setFloat64(next, field, true);
      next += isPointer ? 4 : 8;
    });
    return at;
  }

  read(Type, at, count) {
    return new Type(this.functions.memory.buffer, at, count).slice();
  }

  pieces(p, used = null) {
    return this.struct(
      BigInt(p.moves.length), BigInt(p.shape.length / 2), p.moves, p.turn, p.start_us, p.end_us, p.leg_start_us, p.leg_end_us,
      p.leg_start_deg, p.leg_end_deg, p.bearing_deg, p.shape_offset, p.shape, p.shape_to ?? null, used);
  }

  // Makes a scene of pieces, of which some are used; it is there until it is freed.
  sceneOf(pieces, used = null) {
    return this.call(() => {
      const place = this.room(8);
      this.check(this.functions.kernel_scene_make(this.put(pieces.plane), this.pieces(pieces, used), place));
      return this.read(Uint32Array, place, 1)[0];
    });
  }

  free(scene) {
    this.functions.kernel_scene_free(scene);
  }

  // Calls `ask` with a scene of pieces, of which some are used.
  withScene(pieces, used, ask) {
    const scene = this.sceneOf(pieces, used);
    try {
      return ask(scene);
    } finally {
      this.free(scene);
    }
  }

  check(status) {
    if (status !== OK) throw new Error(`the kernel ended with status ${status}`);
  }

  // The padded hull of each piece: { xy, offset }.
  hulls(pieces, reachM) {
    return this.call(() => {
      const n = pieces.moves.length;
      const xy = this.room(16 * (HULL_PER_VERTEX * (pieces.shape.length / 2) + HULL_MORE * n));
      const [offset, deviation, reach] = [this.room(8 * (n + 1)), this.room(8 * n), this.room(8 * n)];
      this.check(this.functions.kernel_hulls(this.put(pieces.plane), this.pieces(pieces), 0n, BigInt(n), reachM, xy, offset, deviation, reach));
      const offsets = this.read(BigInt64Array, offset, n + 1);
      return { xy: this.read(Float64Array, xy, 2 * Number(offsets[n])), offset: offsets };
    });
  }

  // Whether the hulls of pairs (BigInt64Array) are apart: 1 or 0 each.
  apart({ xy, offset }, a, b) {
    return this.call(() => {
      const found = this.room(a.length);
      this.check(this.functions.kernel_apart(
        this.put(xy), BigInt(xy.length / 2), this.put(offset), BigInt(offset.length - 1), this.put(a), this.put(b), BigInt(a.length), found));
      return this.read(Uint8Array, found, a.length);
    });
  }

  // Whether pairs (BigInt64Array) of rows a and rows b of others may meet: 1 or 0 each. Rows are the columns of
  // KernelBoxes, null for none; compared: of two types, null for all.
  mayMeet(rows, others, { within = 0n, types = 0n, compared = null }, a, b) {
    return this.call(() => {
      const [one, other] = [rows, others].map((columns) => this.struct(BigInt(columns[1].length), ...columns));
      const found = this.room(a.length);
      this.check(this.functions.kernel_may_meet(
        one, other, this.struct(within, types, compared), this.put(a), this.put(b), BigInt(a.length), found));
      return this.read(Uint8Array, found, a.length);
    });
  }

  // Contacts of pairs of a scene: { pair, start, end, error, verdict, touches }, seconds since the zero of the pair.
  contacts(scene, { a, b, zero, low, high, beyond, ofObjects }, { separation_m: separation, tolerance_m: tolerance }) {
    return this.call(() => {
      const pairs = this.struct(BigInt(a.length), a, b, zero, low, high);
      const question = this.struct(separation, tolerance, beyond, ofObjects, null, null);
      const [place, count, work] = [this.room(8), this.room(8), this.room(WORK_BYTES)];
      new Uint8Array(this.functions.memory.buffer, work, WORK_BYTES).fill(0);
      this.check(this.functions.kernel_contacts(scene, pairs, question, place, count, work));
      return this.list(place, count, CONTACT_BYTES, (view, from) => ({
        pair: Number(view.getBigInt64(from, true)), start: view.getFloat64(from + 8, true), end: view.getFloat64(from + 16, true),
        error: view.getFloat64(from + 24, true), verdict: view.getInt32(from + 32, true), touches: view.getInt32(from + 36, true) !== 0,
      }));
    });
  }

  // Distances of pairs of a scene at `low`, metres: minus the depth of overlaps.
  distances(scene, { a, b, zero, low }) {
    return this.call(() => {
      const found = this.room(8 * a.length);
      this.check(this.functions.kernel_distances(scene, this.struct(BigInt(a.length), a, b, zero, low, low), found));
      return this.read(Float64Array, found, a.length);
    });
  }

  // Positions of pieces of a scene at instants, plane metres (2, slots, rows). rows: { piece, at (seconds since the zero of instants),
  // slots: vertices }.
  positions(scene, { piece, at, slots }) {
    return this.moved(piece, slots, (rows, xy) => this.functions.kernel_positions(scene, rows, this.put(at), BigInt(slots), xy));
  }

  // Reference points of havens likewise (2, rows).
  references(scene, { piece, at }) {
    return this.moved(piece, 1, (rows, xy) => this.functions.kernel_references(scene, rows, this.put(at), xy));
  }

  moved(piece, slots, ask) {
    return this.call(() => {
      const n = piece.length;
      const rows = this.struct(BigInt(n), piece, new BigInt64Array(n), new Float64Array(2 * n));
      const xy = this.room(16 * slots * n);
      this.check(ask(rows, xy));
      return this.read(Float64Array, xy, 2 * slots * n);
    });
  }

  // Longitudes and latitudes in turn of places of a plane (2, n).
  degrees(plane, xy) {
    return this.call(() => {
      const found = this.room(8 * xy.length);
      this.check(this.functions.kernel_degrees(this.put(plane), this.put(xy), BigInt(xy.length / 2), found));
      return this.read(Float64Array, found, xy.length);
    });
  }

  // The heading of each leg of waypoints (longitude and latitude in turn), degrees.
  headings(plane, places) {
    return this.call(() => {
      const n = places.length / 2;
      const found = this.room(8 * n);
      this.check(this.functions.kernel_headings(this.put(plane), this.put(places), BigInt(n), found));
      return this.read(Float64Array, found, n - 1);
    });
  }

  // The corners of a convex outline and their rates, metres, when every side moves outward at speed 1: { corner, rate }.
  mitred(outline) {
    return this.call(() => {
      const most = 8 * Math.max(8, outline.length);
      const [corner, rate, count] = [this.room(most), this.room(most), this.room(8)];
      this.check(this.functions.kernel_mitred(this.put(outline), BigInt(outline.length / 2), corner, rate, count));
      const n = Number(this.read(BigInt64Array, count, 1)[0]);
      return { corner: this.read(Float64Array, corner, 2 * n), rate: this.read(Float64Array, rate, 2 * n) };
    });
  }

  // Pieces as KernelHeights; climb_m may be missing.
  heights({ climb_m: climb, floor_m: floor, ceiling_m: ceiling, start_us: start, end_us: end, leg_start_us: legStart, leg_end_us: legEnd }) {
    return this.struct(BigInt(floor.length), climb ?? null, floor, ceiling, start, end, legStart, legEnd);
  }

  // When the heights of pairs overlap during the time that both share, seconds from its start: { first, last, error } of each.
  heightOverlaps(pieces, a, b) {
    return this.call(() => {
      const found = this.room(24 * a.length);
      const [first, last, error] = [0, 1, 2].map((n) => found + 8 * n * a.length);
      this.check(this.functions.kernel_height_overlaps(this.heights(pieces), this.put(a), this.put(b), BigInt(a.length), first, last, error));
      const [firsts, lasts, errors] = [first, last, error].map((at) => this.read(Float64Array, at, a.length));
      return Array.from(a, (_, n) => ({ first: firsts[n], last: lasts[n], error: errors[n] }));
    });
  }

  // Differences of departure that bring pairs of a scene into contact while their heights may overlap, seconds, in parts of the times:
  // { pair, low, high } each.
  differences(scene, pieces, { a, b, aZero, bZero, aEnd, bEnd, least, most }, reachM) {
    return this.call(() => {
      const n = a.length;
      const nothing = new Float64Array(n);
      const times = this.room(40 * n);
      const cut = [0, 1, 2, 3, 4].map((k) => times + 8 * k * n);
      const shifts = (...of) => this.struct(BigInt(n), 0n, a, b, aZero, bZero, ...of, least, most, null);
      this.check(this.functions.kernel_level_shifts(this.heights(pieces), shifts(nothing, aEnd, nothing, bEnd), ...cut));
      const [place, count, work] = [this.room(8), this.room(8), this.room(WORK_BYTES)];
      this.check(this.functions.kernel_difference_parts(scene, shifts(...cut.slice(0, 4).map((at) => ({ at }))), reachM, place, count, work));
      return this.list(place, count, PART_BYTES, (view, at) => ({
        pair: Number(view.getBigInt64(at, true)), low: view.getFloat64(at + 40, true), high: view.getFloat64(at + 64, true),
        isMet: view.getFloat64(at + 8, true) <= view.getFloat64(at + 16, true) && view.getFloat64(at + 24, true) <= view.getFloat64(at + 32, true),
      })).filter(({ isMet }) => isMet);
    });
  }

  // Reads a list that a call allocated, and frees it.
  list(place, count, bytes, one) {
    const from = this.read(Uint32Array, place, 1)[0];
    const view = new DataView(this.functions.memory.buffer);
    const found = Array.from({ length: Number(view.getBigInt64(count, true)) }, (_, n) => one(view, from + bytes * n));
    this.functions.kernel_free(from);
    return found;
  }

  // Pairs of a row of some and a row of a larger object that may meet (`mayMeet`), as [row, row].
  boxPairs(rows, { within = 0n, types = 0n, compared = null }, some) {
    for (let room = 4096; ; room *= 8) {
      const found = this.call(() => {
        const [first, second] = [this.room(8 * room), this.room(8 * room)];
        const [done, count, looked] = [this.room(8), this.room(8), this.room(8)];
        this.check(this.functions.kernel_box_pairs(
          this.struct(BigInt(rows[1].length), ...rows), this.struct(within, types, compared), this.put(some), BigInt(some.length), first, second, BigInt(room), done, count, looked));
        if (this.read(BigInt64Array, done, 1)[0] < BigInt(some.length)) return null; // too little room
        const n = Number(this.read(BigInt64Array, count, 1)[0]);
        const [a, b] = [first, second].map((at) => this.read(BigInt64Array, at, n));
        return Array.from(a, (row, k) => [Number(row), Number(b[k])]);
      });
      if (found !== null) return found;
    }
  }

  // Uses of one place by pairs of tracks within a time, as `useTimes` takes them, with `pair`.
  uses(scene, pieces, a, b, { separation_m: separation, tolerance_m: tolerance, within_us: within }) {
    return this.call(() => {
      const [found, work] = [this.room(USE_BYTES * a.length), this.room(WORK_BYTES)];
      this.check(this.functions.kernel_uses(
        scene, this.heights(pieces), this.struct(BigInt(a.length), BigInt(within), separation, tolerance, a, b), found, work));
      const view = new DataView(this.functions.memory.buffer);
      return Array.from(a, (_, pair) => ({ pair, ...useAt(view, found + USE_BYTES * pair) })).filter(({ isUse }) => isUse);
    });
  }

  // Completes uses { known (USE), spans: [a from, a to, b from, b to], verdict, touches, error, …, start, end (of contacts, seconds) }.
  useTimes(uses, within) {
    return this.call(() => {
      const n = uses.length;
      const found = this.room(USE_BYTES * n);
      const view = new DataView(this.functions.memory.buffer);
      uses.forEach((use, k) => putUse(view, found + USE_BYTES * k, use));
      const spans = [0, 1, 2, 3].map((end) => BigInt64Array.from(uses, (use) => use.spans[end]));
      const times = ["start", "end"].map((name) => Float64Array.from(uses, (use) => use[name] ?? 0));
      const used = this.struct(BigInt(n), BigInt(within), ...spans, Int8Array.from(uses, ({ known }) => known), ...times);
      this.check(this.functions.kernel_use_times(used, found));
      const after = new DataView(this.functions.memory.buffer);
      return uses.map((use, k) => ({ ...use, ...useAt(after, found + USE_BYTES * k) }));
    });
  }

  // Merges contacts { group, from, to (of the shared time), start, end, error (seconds), verdict, touches, lacking, lackingError } of so many
  // groups into periods: { periods: [[from, to], …], error, verdict, lackingError } of each.
  merge(contacts, groups) {
    return this.call(() => {
      const n = contacts.length;
      const integers = (name) => BigInt64Array.from(contacts, (one) => BigInt(one[name]));
      const numbers = (name) => Float64Array.from(contacts, (one) => one[name] ?? NaN);
      const touching = this.struct(
        BigInt(n), BigInt(groups), integers("group"), integers("from"), integers("to"), numbers("start"), numbers("end"), numbers("error"),
        Int8Array.from(contacts, ({ verdict }) => verdict), Uint8Array.from(contacts, ({ touches }) => Number(touches)), numbers("lacking"), numbers("lackingError"));
      const ofContacts = [8, 8, 8, 16].map((bytes) => ({ at: this.room(bytes * n) }));
      const [orderOffset, offset] = [0, 1].map(() => ({ at: this.room(8 * (groups + 1)) }));
      const [error, lacking, lackingError] = [0, 1, 2].map(() => ({ at: this.room(8 * groups) }));
      const [verdict, isOpen, meets] = [0, 1, 2].map(() => ({ at: this.room(groups) }));
      const [start, end, order, period] = ofContacts;
      this.check(this.functions.kernel_merge(touching, this.struct(start, end, order, orderOffset, period, offset, error, verdict, isOpen, meets, lacking, lackingError)));
      const offsets = Array.from(this.read(BigInt64Array, offset.at, groups + 1), Number);
      const [periods, errors] = [this.read(BigInt64Array, period.at, 2 * offsets[groups]), this.read(Float64Array, error.at, groups)];
      const [verdicts, doubts] = [this.read(Int8Array, verdict.at, groups), this.read(Float64Array, lackingError.at, groups)];
      return Array.from({ length: groups }, (_, g) => ({
        periods: Array.from({ length: offsets[g + 1] - offsets[g] }, (__, k) => [0, 1].map((n) => periods[2 * (offsets[g] + k) + n])),
        error: errors[g], verdict: verdicts[g], lackingError: doubts[g],
      }));
    });
  }

  // The closest approach of groups of pairs of a scene, metres: { pair, at (seconds since the zero of the pair), m, error }; m is Infinity
  // beyond the limit, NaN where it is not known.
  approaches(scene, { a, b, zero, low, high }, offset, limitM) {
    return this.call(() => {
      const n = offset.length - 1;
      const pairs = this.struct(BigInt(a.length), a, b, zero, low, high);
      const groups = this.struct(BigInt(n), offset, new Float64Array(n).fill(limitM), new Float64Array(n));
      const [pair, at, m, error, work] = [8 * n, 8 * n, 8 * n, 8 * n, WORK_BYTES].map((bytes) => this.room(bytes));
      const [placeA, placeB] = [this.room(16 * n), this.room(16 * n)];
      this.check(this.functions.kernel_approaches(scene, pairs, groups, pair, at, m, error, placeA, placeB, work));
      const which = this.read(BigInt64Array, pair, n);
      const [ats, metres, errors] = [at, m, error].map((from) => this.read(Float64Array, from, n));
      return Array.from(which, (one, k) => ({ pair: Number(one), at: ats[k], m: metres[k], error: errors[k] }));
    });
  }

  // How deep pairs of a scene, of which b or a is a part of an area, are in the whole area (DEPTH): areas as KernelAreas { ring, ringOffset,
  // areaOffset, margin }.
  wholeDepths(scene, { a, b, zero, low, high }, { ring, ringOffset, areaOffset, margin }, area, isB, east) {
    return this.call(() => {
      const found = this.room(a.length);
      const areas = this.struct(BigInt(margin.length), BigInt(ringOffset.length - 1), BigInt(ring.length / 2), ring, ringOffset, areaOffset, margin);
      this.check(this.functions.kernel_whole_depths(
        scene, this.struct(BigInt(a.length), a, b, zero, low, high), areas, this.put(area), this.put(isB), this.put(east), found));
      return this.read(Int8Array, found, a.length);
    });
  }

  // The least distance of each pair, metres (minus the depth of overlaps), and when: { m, at }; m is Infinity where it is unknown.
  deepest(scene, { a, b, zero, low, high }) {
    return this.call(() => {
      const [m, at] = [0, 1].map(() => this.room(8 * a.length));
      this.check(this.functions.kernel_deepest(scene, this.struct(BigInt(a.length), a, b, zero, low, high), m, at));
      const [metres, ats] = [m, at].map((from) => this.read(Float64Array, from, a.length));
      return Array.from(metres, (one, k) => ({ m: one, at: ats[k] }));
    });
  }
}

// A KernelUse.
function useAt(view, at) {
  const [aFrom, aTo, bFrom, bTo] = [0, 8, 16, 24].map((more) => view.getBigInt64(at + more, true));
  const [error, lacking, lackingError] = [32, 40, 48].map((more) => view.getFloat64(at + more, true));
  const [verdict, touches, isUse] = [72, 76, 80].map((more) => view.getInt32(at + more, true));
  return { times: [aFrom, aTo, bFrom, bTo], error, lacking, lackingError, verdict, touches: touches !== 0, isUse: isUse !== 0 };
}

function putUse(view, at, { times, error, lacking, lackingError, verdict, touches }) {
  (times ?? [0n, 0n, 0n, 0n]).forEach((us, n) => view.setBigInt64(at + 8 * n, us, true));
  [error, lacking ?? 0, lackingError ?? 0, 0, 0].forEach((value, n) => view.setFloat64(at + 32 + 8 * n, value, true));
  [verdict, Number(touches), 1].forEach((value, n) => view.setInt32(at + 72 + 4 * n, value, true));
}
