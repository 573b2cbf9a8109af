// A scene as the page works with it: objects, their motion, conflicts, and which of them a filter leaves.
// Unpacks conflicts and tracks of map/content.py and outlines of `_map_overview` (sql/84_map_page.sql).

import { printable } from "./format.js";
import { LAYERS, layersOf } from "./heights.js";
import { begun, Motion } from "./motion.js";
import { shorter } from "./world.js";

export const MERCATOR_END = 85.051129; // degrees of latitude at which Web Mercator ends
// What is not known of a conflict of a moved plan.
const UNKNOWN = {
  is_current: true, lon: null, lat: null, west: null, south: null, east: null, north: null, isBeyond: false,
  acknowledged_by: null, acknowledged_for: null, acknowledged_until: null, rank: null, missing: null, deepest: null,
};
export const VERDICTS = ["conflict", "grazing", "unresolved"];

const decoder = new TextDecoder();

// The JSON before what is packed, and where that begins.
function headOf(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  return { head: JSON.parse(decoder.decode(new Uint8Array(buffer, 4, length))), at: 4 + length };
}

function records({ columns, rows }) {
  return rows.map((row) => Object.fromEntries(columns.map((name, i) => [name, row[i]])));
}

// Well-known binary, little-endian: a line of points with a measure, a ring of a polygon, or several polygons.
function points(view, at) {
  const count = view.getUint32(at + 5, true);
  return Array.from({ length: count }, (_, n) => ({
    lon: view.getFloat64(at + 9 + 24 * n, true),
    lat: view.getFloat64(at + 17 + 24 * n, true),
    t: view.getFloat64(at + 25 + 24 * n, true),
  }));
}

function ring(view, at) {
  const count = view.getUint32(at + 9, true);
  return Array.from({ length: count }, (_, n) => [
    view.getFloat64(at + 13 + 16 * n, true), view.getFloat64(at + 21 + 16 * n, true),
  ]);
}

function rings(view, at) {
  const found = [];
  let place = at + 9;
  for (let n = view.getUint32(at + 5, true); n > 0; n -= 1) {
    found.push(ring(view, place));
    place += 13 + 16 * found[found.length - 1].length;
  }
  return found;
}

// Tracks from what conflictdb/map/content.py packs.
export function unpackTracks(buffer, scene) {
  const view = new DataView(buffer);
  let { head: { rows }, at } = headOf(buffer);
  return rows.map(([id, key, name, floor, ceiling, grow, departures, pathSize, outlineSize, outlinesSize]) => {
    const path = points(view, at);
    at += pathSize;
    const outline = outlineSize === null ? null : ring(view, at);
    at += outlineSize ?? 0;
    const outlines = outlinesSize === null ? null : rings(view, at);
    at += outlinesSize ?? 0;
    const motion = new Motion(path, outline ?? outlines[0], grow ?? 0, outlines, scene, departures);
    return { kind: "track", id, key, name, floor, ceiling, start: motion.start, end: motion.end, spans: motion.spans, motion };
  });
}

// Conflicts from what routine _map_conflicts packs: when (Unix seconds, or infinite), where (degrees, null: not known), how
// sure, and who acknowledged them.
export function unpackConflicts(buffer) {
  const view = new DataView(buffer);
  let { head: { a, b, acknowledged }, at } = headOf(buffer);
  const known = new Map(acknowledged.map(([n, ...what]) => [n, what]));
  const nobody = [null, null, null];
  return a.map((key, n) => {
    const [lon, west] = [view.getFloat64(at + 20), view.getFloat32(at + 36)];
    const [isPlaced, isSeen] = [!Number.isNaN(lon), !Number.isNaN(west)];
    const [by, why, until] = known.get(n) ?? nobody;
    const first = at + 56;
    const periods = Array.from({ length: view.getInt32(at + 52) }, (_, i) => (
      [view.getFloat64(first + 16 * i), view.getFloat64(first + 16 * i + 8)]));
    const conflict = {
      id: Number(view.getBigInt64(at)), a: key, b: b[n], verdict: VERDICTS[view.getInt16(at + 8)],
      is_current: view.getInt16(at + 10) === 1, error_s: view.getFloat64(at + 12),
      lon: isPlaced ? lon : null, lat: isPlaced ? view.getFloat64(at + 28) : null,
      west: isSeen ? west : null, south: isSeen ? view.getFloat32(at + 40) : null,
      east: isSeen ? view.getFloat32(at + 44) : null, north: isSeen ? view.getFloat32(at + 48) : null,
      acknowledged_by: by, acknowledged_for: why, acknowledged_until: until, rank: null, missing: null, deepest: null,
      periods, start: periods[0]?.[0] ?? -Infinity, end: periods[periods.length - 1]?.[1] ?? Infinity,
    };
    conflict.isBeyond = isPlaced && Math.abs(conflict.lat) > MERCATOR_END;
    at = first + 16 * periods.length;
    return conflict;
  });
}

// Conflicts as they were known before: [[a, b, verdict, error, periods], …].
export function formerConflicts(rows) {
  return rows.map(([a, b, verdict, error_s, spans], n) => {
    const periods = spans.map(([start, end]) => [start ?? -Infinity, end ?? Infinity]);
    return { ...UNKNOWN, id: -1 - n, a, b, verdict, error_s, periods, start: periods[0]?.[0] ?? -Infinity, end: periods[periods.length - 1]?.[1] ?? Infinity };
  });
}

// Outlines of areas from what routine _map_overview packs: [{id, rings}], each ring longitudes and latitudes in turn, outer
// ones anticlockwise and holes clockwise.
export function unpackOutlines(buffer) {
  const view = new DataView(buffer);
  const areas = [];
  let at = 0;
  while (at < buffer.byteLength) {
    const area = { id: Number(view.getBigInt64(at)), rings: [] };
    let polygons = view.getUint32(at + 13, true); // after the number, the order of bytes and the type
    at += 17;
    for (; polygons > 0; polygons -= 1) {
      const count = view.getUint32(at + 5, true);
      at += 9;
      for (let n = 0; n < count; n += 1) {
        const numbers = new Float64Array(2 * view.getUint32(at, true));
        at += 4;
        for (let i = 0; i < numbers.length; i += 1, at += 8) numbers[i] = view.getFloat64(at, true);
        area.rings.push(windsLeft(numbers) === (n === 0) ? numbers : backward(numbers));
      }
    }
    areas.push(area);
  }
  return areas;
}

function windsLeft(ring) {
  let doubled = 0;
  for (let i = 2; i + 3 < ring.length; i += 2) {
    doubled += (ring[i] - ring[0]) * (ring[i + 3] - ring[1]) - (ring[i + 2] - ring[0]) * (ring[i + 1] - ring[1]);
  }
  return doubled >= 0;
}

function backward(ring) {
  return ring.map((_, i) => ring[ring.length - 2 - i + 2 * (i % 2)]);
}

function areaOf({ id, key, name, floor_m: floor, ceiling_m: ceiling, start, end, spans, west, south, east, north, lon, lat }) {
  return {
    kind: "area", id, key, name, floor, ceiling, start, end, spans: spans && spansOf(spans), box: [west, south, east, north], inside: [lon ?? (west + east) / 2, lat ?? (south + north) / 2],
  };
}

// Activations from their starts and ends in turn, null for no limit.
function spansOf(ends) {
  return Array.from({ length: ends.length / 2 }, (_, n) => [ends[2 * n] ?? -Infinity, ends[2 * n + 1] ?? Infinity]);
}

// Whether an object is there at some instant of a range, or at one instant.
export function isThere({ spans, start, end }, from, to = from) {
  if (!spans) return (start ?? -Infinity) <= to && (end ?? Infinity) >= from;
  const n = begun(spans, to);
  return n > 0 && spans[n - 1][1] >= from;
}

// When an object is there next, after an instant; null: never.
export function nextStart({ spans, start }, t) {
  const starts = spans ? spans.map(([from]) => from) : [start ?? -Infinity];
  return starts.find((from) => from > t) ?? null;
}

// A latitude beyond which the map shows nothing, of what an object reaches.
function reachesBeyond(object) {
  if (object.kind === "area") return object.box[1] < -MERCATOR_END || object.box[3] > MERCATOR_END;
  return object.motion.points.some(({ lat }) => Math.abs(lat) > MERCATOR_END);
}

export class Model {
  constructor(scene) {
    this.scene = scene;
    this.areas = [];
    this.tracks = [];
    this.outlines = [];
    this.objects = new Map();
    this.conflicts = [];
    this.ranked = new Map();
    this.beyond = 0;
    this.knownBox = null;
    this.spare = null; // a span that the timeline shows, too
    this.refused = null; // why the scene is not there any more, of one of which nothing may be shown
  }

  takeObjects(areas, tracks, outlines) {
    this.knownBox = null;
    this.outlines = outlines && unpackOutlines(outlines);
    this.areas = records(areas).map(areaOf);
    this.tracks = unpackTracks(tracks, this.scene);
    this.objects = new Map([...this.areas, ...this.tracks].map((object) => [object.key, object]));
    this.beyond = [...this.areas, ...this.tracks].filter(reachesBeyond).length;
    this.span = this.spanOfAll();
  }

  // floors and ceilings of tracks whose heights change, per leg or per waypoint.
  takeHeights(heights) {
    for (const [key, [floors, ceilings]] of Object.entries(heights)) {
      const track = this.objects.get(key);
      if (track) Object.assign(track, { floors, ceilings });
    }
  }

  takeConflicts(conflicts) {
    this.conflicts = unpackConflicts(conflicts);
    this.span = this.spanOfAll();
    this.rank();
  }

  // Conflicts, the worst first (core/ranking.py): [[id, when most of the separation is missing, and how much, in words and metres], …]. All but
  // the id are null where they are not known.
  takeRanked(ranked) {
    this.ranked = new Map(ranked.map(([id, ...known], n) => [id, [n, ...known]]));
    this.rank();
  }

  conflictsOf(key) {
    return this.conflicts.filter(({ a, b }) => a === key || b === key);
  }

  get isRanked() {
    return this.ranked.size > 0;
  }

  rank() {
    for (const conflict of this.conflicts) {
      const [rank, deepest, word, m] = this.ranked.get(conflict.id) ?? [null, null, null, null];
      Object.assign(conflict, { rank, deepest, missing: word === null ? null : [word, m] });
    }
  }

  // From when to when something moves, or begins or ends: what the timeline shows.
  spanOfAll() {
    let [from, to] = [Infinity, -Infinity];
    const take = (t) => {
      if (t !== null && Number.isFinite(t)) {
        from = Math.min(from, t);
        to = Math.max(to, t);
      }
    };
    for (const track of this.tracks) {
      take(track.start);
      take(track.end);
    }
    for (const { periods } of this.conflicts) for (const [a, b] of periods) { take(a); take(b); }
    if (this.spare) this.spare.forEach(take);
    if (from > to) for (const area of this.areas) { take(area.start); take(area.end); }
    if (from > to) [from, to] = [Date.now() / 1000 - 43200, Date.now() / 1000 + 43200];
    return to - from < 60 ? [from - 1800, to + 1800] : [from, to];
  }

  // Shows a span, too, or no other one.
  spareSpan(span) {
    this.spare = span;
    this.span = this.spanOfAll();
  }

  // The box that holds all there is, as narrow as it can be: it may reach across the date line (east > 180).
  box() {
    this.knownBox ??= this.boxOfAll();
    return this.knownBox;
  }

  boxOfAll() {
    const spans = [];
    let [south, north] = [90, -90];
    const take = (west, south0, east, north0) => {
      spans.push([west, east]);
      south = Math.min(south, south0);
      north = Math.max(north, north0);
    };
    for (const { box } of this.areas) take(...box);
    for (const { motion } of this.tracks) {
      let lon = motion.points[0].lon;
      let [west, east, low, high] = [lon, lon, 90, -90];
      motion.points.forEach((p, i) => {
        if (i > 0) lon += shorter(p.lon - motion.points[i - 1].lon);
        [west, east] = [Math.min(west, lon), Math.max(east, lon)];
        [low, high] = [Math.min(low, p.lat), Math.max(high, p.lat)];
      });
      take(west, low, east, high);
    }
    if (!spans.length) return [-170, -60, 170, 75];
    const [west, east] = narrowest(spans);
    return [west, south, east, north];
  }

  // The conflicts if a track departs at another time: those that would be gone, moved or new have a `change`.
  withPlan({ key, upM, conflicts }) {
    const known = new Map(conflicts.map((one) => [one.other, one]));
    const changed = this.conflicts.map((conflict) => {
      if (conflict.a !== key && conflict.b !== key) return conflict;
      const other = conflict.a === key ? conflict.b : conflict.a;
      const now = known.get(other);
      known.delete(other);
      return now ? this.planned({ ...conflict, was: { start: conflict.start, end: conflict.end } }, now, "moved", key, upM) : { ...conflict, change: "gone" };
    });
    const added = [...known.values()].map((now, n) => {
      const isArea = (one) => this.objects.get(one)?.kind === "area";
      const isOtherFirst = isArea(key) === isArea(now.other) ? now.other < key : isArea(now.other);
      const [a, b] = isOtherFirst ? [now.other, key] : [key, now.other];
      return this.planned({ ...UNKNOWN, id: -1 - n, a, b }, now, "new", key, upM);
    });
    return [...changed, ...added].sort((one, other) => one.start - other.start || one.id - other.id);
  }

  planned(conflict, { verdict, periods, error_s }, change, key, upM) {
    return { ...conflict, ...UNKNOWN, verdict: verdict ?? "unresolved", periods, error_s, start: periods[0][0], end: periods[periods.length - 1][1], change, higher: [key, upM] };
  }

  // The heights where both objects of a conflict may be: [floor, ceiling], metres.
  heightsOf({ a, b, higher: [key, upM] = [null, 0] }) {
    const pair = [this.objects.get(a), this.objects.get(b)];
    const moved = (object, end) => end + (object.key === key ? upM : 0);
    return [
      Math.max(...pair.map((object) => (object ? moved(object, object.floor ?? -Infinity) : -Infinity))),
      Math.min(...pair.map((object) => (object ? moved(object, object.ceiling ?? Infinity) : Infinity))),
    ];
  }

  // The box to show of a conflict: both havens at an instant, and the place of contact.
  around(conflict, t) {
    const middle = conflict.lon ?? (conflict.west + conflict.east) / 2;
    const spans = [];
    const take = (lon, lat) => spans.push([middle + ((((lon - middle + 180) % 360) + 360) % 360) - 180, lat]);
    if (conflict.lon !== null) take(conflict.lon, conflict.lat);
    const isNarrow = conflict.east - conflict.west < 180;
    if (conflict.west !== null && isNarrow) {
      take(conflict.west, conflict.south);
      take(conflict.east, conflict.north);
    }
    for (const key of [conflict.a, conflict.b]) {
      const object = this.objects.get(key);
      if (object?.kind === "track") for (const [lon, lat] of object.motion.haven(t) ?? []) take(lon, lat);
    }
    if (!spans.length) return this.box();
    const [lons, lats] = [spans.map(([lon]) => lon), spans.map(([, lat]) => lat)];
    return [Math.min(...lons), Math.min(...lats), Math.max(...lons), Math.max(...lats)];
  }
}

// The smallest span of longitudes that holds all of some, [west, east] with west within +-180.
export function narrowest(spans) {
  const sorted = spans
    .map(([west, east]) => {
      const turn = 360 * Math.floor((west + 180) / 360);
      return [west - turn, east - turn];
    })
    .sort((a, b) => a[0] - b[0]);
  // The widest gap between what comes before, all around, and the next one.
  let reached = Math.max(...sorted.map(([, east]) => east)) - 360;
  let [west, gap] = [sorted[0][0], -Infinity];
  for (const [start, end] of sorted) {
    if (start - reached > gap) {
      gap = start - reached;
      west = start;
    }
    reached = Math.max(reached, end);
  }
  return gap <= 0 ? [-180, 180] : [west, west + 360 - gap];
}

// How long a conflict lasts, seconds: all of its periods.
export const lasting = ({ periods }) => periods.reduce((sum, [start, end]) => sum + end - start, 0);

// Conflicts in the order of a list: what a moved plan changes, by time; then the worst first, as the server ranks them.
export function worstFirst(conflicts) {
  const rankOf = (one) => (one.change || one.since ? -1 : one.rank ?? Infinity);
  const differ = (a, b) => (a === b ? 0 : a - b); // also of two without a rank
  return [...conflicts].sort((one, other) => differ(rankOf(one), rankOf(other)));
}

// Whether two spans of heights have one in common.
export const meet = ([floor, ceiling], [other, top]) => Math.max(floor, other) < Math.min(ceiling, top);

// What a filter leaves. Words are of keys and names, in any case; a height counts where both objects may be.
export class Filter {
  constructor() {
    this.text = "";
    this.verdicts = new Set(VERDICTS);
    this.from = -Infinity;
    this.to = Infinity;
    this.floor = -Infinity;
    this.ceiling = Infinity;
    this.layers = new Set(LAYERS); // below the sea level, at it, in the air (heights.js)
    this.open = false; // only what is not acknowledged
    this.now = false; // only what is on at the time that is shown
  }

  isNothing() {
    const plain = new Filter();
    return this.text === "" && this.verdicts.size === VERDICTS.length && this.layers.size === LAYERS.length && !this.open && !this.now
      && ["from", "to", "floor", "ceiling"].every((name) => this[name] === plain[name]);
  }

  names(object) {
    const wanted = this.text.trim().toLowerCase();
    if (wanted === "") return true;
    return object !== undefined
      && [object.key, object.name ?? ""].some((text) => [text, printable(text)].some((one) => one.toLowerCase().includes(wanted)));
  }

  isInLayers(object) {
    return this.layers.size === LAYERS.length || layersOf(object).some((one) => this.layers.has(one));
  }

  leavesObject(object) {
    return this.isInLayers(object) && isThere(object, this.from, this.to)
      && (object.floor ?? -Infinity) < this.ceiling && (object.ceiling ?? Infinity) > this.floor;
  }

  leaves(conflict, model, t) {
    const pair = [model.objects.get(conflict.a), model.objects.get(conflict.b)];
    return this.verdicts.has(conflict.verdict)
      && conflict.periods.some(([a, b]) => a <= this.to && b >= this.from && (!this.now || (t >= a && t <= b)))
      && meet(model.heightsOf(conflict), [this.floor, this.ceiling])
      && !(this.open && conflict.acknowledged_by !== null)
      && pair.every((object) => object === undefined || this.isInLayers(object))
      && pair.some((object, i) => this.names(object ?? { key: [conflict.a, conflict.b][i], name: null }));
  }
}
