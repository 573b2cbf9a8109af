// Height bands of objects: metres above the vertical datum of the scene, infinite where there is no limit.

export const LAYERS = ["below", "surface", "air"];

const low = (m) => m ?? -Infinity;
const high = (m) => m ?? Infinity;

// The layers of an object: below the sea level, at it, in the air. Without a limit below it, it is below, too; above, in the air.
export function layersOf({ floor, ceiling }) {
  const [from, to] = [low(floor), high(ceiling)];
  if (from >= 0) return to > 0 && from === 0 ? ["surface", "air"] : ["air"];
  if (to <= 0) return ["below"];
  return [...(from === -Infinity ? ["below"] : []), "surface", ...(to === Infinity ? ["air"] : [])];
}

// The bands of an object over time: [{ t0, t1, floor: [at t0, at t1], ceiling: [at t0, at t1] }], within a span.
export function bandsOf(object, [from, to]) {
  const spans = object.spans ?? object.motion?.spans ?? [[object.start ?? -Infinity, object.end ?? Infinity]];
  return spans.flatMap((span) => bandsWithin(object, span, from, to));
}

// The bands of one voyage, or of one time that an area is active.
function bandsWithin(object, [start, end], from, to) {
  if (!object.floors && !object.ceilings) {
    const [t0, t1] = [Math.max(from, start), Math.min(to, end)];
    return t0 <= t1 ? [{ t0, t1, floor: [low(object.floor), low(object.floor)], ceiling: [high(object.ceiling), high(object.ceiling)] }] : [];
  }
  const { points } = object.motion;
  const legs = points.length - 1;
  const later = start - points[0].t;
  return points.slice(1).flatMap(({ t }, n) => {
    const band = {
      t0: points[n].t + later, t1: t + later, floor: endsOf(object.floors, n, legs, object.floor, low), ceiling: endsOf(object.ceilings, n, legs, object.ceiling, high),
    };
    return band.t1 >= from && band.t0 <= to ? [cut(band, from, to)] : [];
  });
}

// Heights at both ends of leg n, of one height per leg or one per waypoint.
function endsOf(heights, n, legs, all, limit) {
  if (!heights) return [limit(all), limit(all)];
  if (heights.length === legs) return [limit(heights[n]), limit(heights[n])];
  const ends = [limit(heights[n]), limit(heights[n + 1])];
  return ends.every(Number.isFinite) ? ends : [limit(null), limit(null)];
}

const between = ([a, b], share) => (a === b ? a : a + share * (b - a));

function cut({ t0, t1, floor, ceiling }, from, to) {
  const long = t1 - t0;
  const [first, last] = [Math.max(t0, from), Math.min(t1, to)];
  const shares = long > 0 ? [(first - t0) / long, (last - t0) / long] : [0, 0];
  return { t0: first, t1: last, floor: shares.map((share) => between(floor, share)), ceiling: shares.map((share) => between(ceiling, share)) };
}

// The band at an instant, [floor, ceiling]; null where the object is not there.
export function bandAt(object, t) {
  const [band] = bandsOf(object, [t, t]);
  return band ? [band.floor[0], band.ceiling[0]] : null;
}

// How far one object is above another one during a span: [metres, "above" or "below"], the least; null where heights meet.
export function apartDuring(one, other, span) {
  let least = null;
  for (const mine of bandsOf(one, span)) {
    for (const theirs of bandsOf(other, [mine.t0, mine.t1])) {
      const own = cut(mine, theirs.t0, theirs.t1);
      const above = Math.min(theirs.floor[0] - own.ceiling[0], theirs.floor[1] - own.ceiling[1]);
      const below = Math.min(own.floor[0] - theirs.ceiling[0], own.floor[1] - theirs.ceiling[1]);
      if (above < 0 && below < 0) return null;
      const found = above >= 0 ? [above, "above"] : [below, "below"];
      if (least === null || found[0] < least[0]) least = found;
    }
  }
  return least;
}
