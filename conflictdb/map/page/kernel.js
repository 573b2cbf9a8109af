// The kernel of detections as WebAssembly (kernel.wasm): structures as kernel.h has them, with pointers of 32 bits.

const ABI = 25; // KERNEL_ABI that the structures below are of
const OK = 0;
const DIFFERENCE_BYTES = 72; // KernelDifference
const CONTACT_BYTES = 40; // KernelContact
const WORK_BYTES = 56; // KernelWork
const HULL_PER_VERTEX = 6;
const HULL_MORE = 5;

export const DIFFERENCE = { NONE: 0, INNER: 1, OUTER: 2, UNKNOWN: 3 };
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

  // Makes a structure of BigInts (64 bits), numbers (doubles) and typed arrays or null (pointers).
  struct(...fields) {
    const pointers = fields.map((field) => (ArrayBuffer.isView(field) || field === null ? this.put(field) : null));
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
      const at = this.read(Uint32Array, place, 1)[0];
      const view = new DataView(this.functions.memory.buffer);
      const n = Number(view.getBigInt64(count, true));
      const found = Array.from({ length: n }, (_, i) => {
        const from = at + CONTACT_BYTES * i;
        return {
          pair: Number(view.getBigInt64(from, true)), start: view.getFloat64(from + 8, true), end: view.getFloat64(from + 16, true),
          error: view.getFloat64(from + 24, true), verdict: view.getInt32(from + 32, true), touches: view.getInt32(from + 36, true) !== 0,
        };
      });
      this.functions.kernel_free(at);
      return found;
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

  // Differences of departure that bring pairs of a scene into contact, seconds: { state, outer: [low, high], inner }.
  differences(scene, { a, b, aZero, bZero, aStart, aEnd, bStart, bEnd, least, most }, reachM) {
    return this.call(() => {
      const shifts = this.struct(BigInt(a.length), 0n, a, b, aZero, bZero, aStart, aEnd, bStart, bEnd, least, most, null);
      const [found, work] = [this.room(DIFFERENCE_BYTES * a.length), this.room(WORK_BYTES)];
      new Uint8Array(this.functions.memory.buffer, work, WORK_BYTES).fill(0);
      this.check(this.functions.kernel_differences(scene, shifts, reachM, found, work));
      const view = new DataView(this.functions.memory.buffer, found);
      return Array.from(a, (_, i) => {
        const [low, innerLow, innerHigh, high] = [0, 8, 16, 24].map((more) => view.getFloat64(DIFFERENCE_BYTES * i + more, true));
        return { state: view.getInt32(DIFFERENCE_BYTES * i + 32, true), outer: [low, high], inner: [innerLow, innerHigh] };
      });
    });
  }
}
