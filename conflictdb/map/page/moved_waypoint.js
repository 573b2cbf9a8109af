// A track with a waypoint elsewhere: the pieces of its legs are made anew, as conflictdb/core/pieces/cutting.py makes them, but
// each leg is one piece; hulls of whole legs cover more, and the contacts are the same.

import { boxes, hullsOf, rowsOf, taken } from "./near.js";
import { shorter } from "./world.js";

const TOLERANCES = ["xtd_port_m", "xtd_starboard_m", "min_speed_kn", "max_speed_kn", "turn_radius_m", "departure_window", "arrival_window"];
const ALLOWANCE_M = 1; // hulls that end so near to the seam are on both sides of it

// Places of a plan, degrees: longitudes run on across the date line, and keep their digits.
function unwrapped(coordinates) {
  let sum = coordinates[0][0];
  return coordinates.map(([lon, lat], n) => {
    if (n > 0) sum += shorter(lon - coordinates[n - 1][0]);
    return { lon: lon + 360 * Math.round((sum - lon) / 360), lat };
  });
}

// Of each leg of an object, of each voyage, the rows of a pack of its first and its last piece, in order of time.
function legsOf(pack, object) {
  const legs = new Map();
  pack.object.forEach((one, row) => {
    if (one !== object || pack.turn[row] !== 0) return;
    const leg = legs.get(pack.leg_start_us[row]) ?? { row, last: row };
    if (pack.start_us[row] > pack.start_us[leg.last]) leg.last = row;
    legs.set(pack.leg_start_us[row], leg);
  });
  return [...legs].sort(([a], [b]) => (a < b ? -1 : 1)).map(([, leg]) => leg);
}

// A pack (unpackPieces) of a track with a waypoint [n, longitude, latitude] elsewhere, and of what it may meet there. Throws an Error
// where it cannot be there.
export function withWaypoint(kernel, pack, key, [n, lon, lat]) {
  const object = pack.objects.indexOf(key);
  const { coordinates } = pack.plans[key].geometry;
  const places = unwrapped(coordinates.map((place, i) => (i === n ? [lon, lat] : place)));
  const bearings = kernel.headings(pack.plane, Float64Array.from(places.flatMap((place) => [place.lon, place.lat])));
  const legs = legsOf(pack, object).map((leg, nth) => {
    const i = nth % bearings.length;
    return { ...leg, from: places[i], to: places[i + 1], bearing: bearings[i], turn: 0 };
  });
  if (legs.length % bearings.length !== 0 || TOLERANCES.some((name) => name in pack.plans[key].properties)) throw new Error("the plan has tolerances");
  const hulls = boxes(kernel.hulls(packed(pack, legs, []), pack.reach_m));
  const made = legs.flatMap((leg, nth) => onTurns(leg, hulls[nth], pack.turn_m));
  return packed(pack, made, othersNear(kernel, pack, object, made));
}

// The rows of other objects whose boxes legs meet, and of what could not be cut.
function othersNear(kernel, pack, object, legs) {
  const all = [...legs.map(({ box }) => box), ...boxes(hullsOf(kernel, pack))];
  const count = all.length;
  const nothing = (Type) => new Type(count);
  const legFirst = Int32Array.from(all, (_, n) => (n < legs.length ? 0 : 1));
  const rows = rowsOf({ object: legFirst, turn: nothing(Int16Array), type: nothing(Int32Array) }, { boxes: Float64Array.from(all.flat()) }, false);
  const met = kernel.boxPairs(rows, {}, BigInt64Array.from(legs, (_, n) => BigInt(n))).map(([, row]) => row - legs.length);
  const near = new Set([...met, ...[...pack.is_cover.keys()].filter((row) => pack.is_cover[row])]);
  return [...near].filter((row) => pack.object[row] !== object).sort((one, other) => one - other);
}

// A leg where its hull begins within half a turn of the prime meridian, and copies a turn further west of one that reaches beyond.
function onTurns(leg, [west, south, east, north], turnM) {
  if (!(west <= east)) throw new Error("it leaves the plane of the scene");
  const away = turnM ? Math.floor(west / turnM + 0.5) : 0;
  const copies = turnM ? Math.floor((east + ALLOWANCE_M) / turnM - away + 0.5) : 0;
  const moved = ({ lon, lat }) => ({ lon: lon - 360 * away, lat });
  return Array.from({ length: copies + 1 }, (_, turn) => {
    const by = turnM * (away + turn);
    return { ...leg, from: moved(leg.from), to: moved(leg.to), turn: -turn, box: [west - by, south, east - by, north] };
  });
}

// A pack of legs, and of some rows of another pack.
function packed(pack, legs, others) {
  const rows = [...legs.map(({ row }) => row), ...others];
  const made = { ...pack, hulls: null, columns: null, ...taken(pack, rows) };
  legs.forEach(({ last, from, to, bearing, turn }, row) => {
    made.start_us[row] = made.leg_start_us[row];
    made.end_us[row] = made.leg_end_us[row];
    made.end_inclusive[row] = pack.end_inclusive[last];
    made.leg_start_deg.set([from.lon, from.lat], 2 * row);
    made.leg_end_deg.set([to.lon, to.lat], 2 * row);
    made.bearing_deg[row] = bearing;
    made.turn[row] = turn;
  });
  return made;
}
