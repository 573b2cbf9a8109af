// When two objects are at one place, whatever their heights: at instants so near to each other that nothing moves past
// between them unseen.

import { seenFrom } from "./plan.js";
import { RADIANS, shorter, SPHERE_M } from "./world.js";

const MOST_STEPS = 20_000; // through the time that two objects share
const COARSE = 600; // steps while they are at one place
const SURE = 0.99; // of a distance on a sphere, for one on the ellipsoid
const SURE_NEAR = 0.9; // of one in a plane, from the middle of an object
const EXACT_S = 0.5; // ends of a pass are right to within this
const MOST_LAT = 89.9;
const NEAR_M = 200_000; // so far from the middle of a plane it is true enough

function metresBetween([lon, lat], [lon2, lat2]) {
  const [half, across] = [Math.sin(((lat2 - lat) * RADIANS) / 2), Math.sin(((lon2 - lon) * RADIANS) / 2)];
  const share = half * half + Math.cos(lat * RADIANS) * Math.cos(lat2 * RADIANS) * across * across;
  return 2 * SPHERE_M * Math.asin(Math.min(1, Math.sqrt(share)));
}

// The fastest that a track is on any leg, metres a second.
function speedOf({ points, grow }) {
  let most = 0;
  for (let n = 1; n < points.length; n += 1) {
    const way = (p) => [p.lon, p.lat];
    const rhumb = Math.max(metresBetween(way(points[n - 1]), way(points[n])), metresAlong(points[n - 1], points[n]));
    if (points[n].t > points[n - 1].t) most = Math.max(most, rhumb / (points[n].t - points[n - 1].t));
  }
  return most / SURE + 2 * grow;
}

// No less than the length of a rhumb line.
function metresAlong(from, to) {
  const widest = Math.cos(Math.min(Math.abs(from.lat), Math.abs(to.lat)) * RADIANS);
  const turn = Math.abs(to.lon - from.lon) % 360;
  return SPHERE_M * RADIANS * Math.hypot(to.lat - from.lat, Math.min(turn, 360 - turn) * (from.lat * to.lat < 0 ? 1 : widest));
}

// An object as something that is somewhere: { span, speed, turns, at(t): { middle, reach, rings }, or null between voyages }; rings of an
// area: longitudes and latitudes, null where they are not known.
export function presence(object, rings) {
  if (object.kind === "track") {
    const { motion } = object;
    const first = motion.points[0].t;
    const starts = motion.spans?.map(([start]) => start) ?? [first];
    return {
      span: [object.start, object.end], speed: speedOf(motion), turns: starts.flatMap((start) => motion.points.map(({ t }) => t - first + start)),
      at: (t) => {
        const within = motion.place(t) ? t : t - 1e-6; // the last instant belongs to no leg
        const middle = motion.place(within);
        return middle && { middle, reach: motion.reachM, rings: () => [motion.haven(within)] };
      },
    };
  }
  if (!rings) return null;
  const [west, south, east, north] = object.box;
  const middle = [(west + east) / 2, (south + north) / 2];
  const reach = Math.max(...rings.flat().map((place) => metresBetween(middle, place))) / SURE;
  const still = { middle, reach, rings: () => rings };
  return { span: [object.start ?? -Infinity, object.end ?? Infinity], speed: 0, turns: [], at: () => still };
}

// Spans of time in which two presences share a place: [[from, to], …], Unix seconds. Between two steps nothing can come as far
// as the distance that is between them; at waypoints havens turn.
export function passes(one, other) {
  const [from, to] = [Math.max(one.span[0], other.span[0]), Math.min(one.span[1], other.span[1])];
  if (!(from <= to) || !Number.isFinite(from) || !Number.isFinite(to)) return [];
  const closing = one.speed + other.speed;
  const finest = Math.max(EXACT_S, (2 * (to - from)) / MOST_STEPS);
  const share = (t) => {
    const [a, b] = [one.at(t), other.at(t)];
    return a !== null && b !== null && meets(a.rings(), b.rings());
  };
  const turns = [...one.turns, ...other.turns].filter((t) => t > from && t < to).sort((a, b) => a - b);
  const found = [];
  let [t, before, was, next] = [from, from, false, 0];
  for (let n = 0; n < MOST_STEPS; n += 1) {
    const [a, b] = [one.at(t), other.at(t)];
    let gap = a && b ? SURE * metresBetween(a.middle, b.middle) - a.reach - b.reach : Infinity;
    const is = gap <= 0 && share(t);
    if (gap <= 0) gap = is ? 0 : SURE_NEAR * metresApart(a.middle, a.rings(), b.rings());
    if (is && !was) found.push([n === 0 ? t : edge(share, before, t), t]);
    if (!is && was) found[found.length - 1][1] = edge(share, t, before);
    else if (is) found[found.length - 1][1] = t;
    if (t >= to) break;
    [before, was] = [t, is];
    while (turns[next] <= t) next += 1;
    const step = is ? (to - from) / COARSE : closing > 0 ? gap / closing : Infinity;
    t = Math.min(to, turns[next] ?? to, t + Math.max(finest, step));
  }
  return found;
}

// How far two presences are from each other at an instant, about, and no more than they are: { m, least }; 0 at one place.
export function apartAt(one, other, t) {
  const [a, b] = [one.at(t), other.at(t)];
  if (!a || !b) return { m: Infinity, least: Infinity };
  const far = metresBetween(a.middle, b.middle);
  const gap = SURE * far - a.reach - b.reach;
  const [own, theirs] = [a.rings(), b.rings()];
  if (gap <= 0 && meets(own, theirs)) return { m: 0, least: 0 };
  const m = metresApart(a.middle, own, theirs, ([lon, lat]) => seenFrom(a.middle, [lon, lat]));
  return { m, least: Math.max(0, gap, far < NEAR_M ? SURE_NEAR * m : 0) };
}

// Metres between rings, about, in the plane about a place.
function metresApart([lon0, lat0], rings, others, seen = null) {
  const across = Math.cos(lat0 * RADIANS) * SPHERE_M * RADIANS;
  const flat = (all) => all.map((ring) => ring.map(seen ?? (([lon, lat]) => [shorter(lon - lon0) * across, (lat - lat0) * SPHERE_M * RADIANS])));
  const [own, theirs] = [flat(rings), flat(others)];
  let least = Infinity;
  for (const [some, sides] of [[own, theirs], [theirs, own]]) {
    for (const place of some.flat()) {
      for (const ring of sides) for (let n = 1; n < ring.length; n += 1) least = Math.min(least, fromSide(place, ring[n - 1], ring[n]));
    }
  }
  return least;
}

function fromSide([x, y], [x0, y0], [x1, y1]) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const long = dx * dx + dy * dy;
  const share = long > 0 ? Math.min(1, Math.max(0, ((x - x0) * dx + (y - y0) * dy) / long)) : 0;
  return Math.hypot(x - x0 - share * dx, y - y0 - share * dy);
}

// The first instant of sharing a place, between one without and one with it; either may be the later one.
function edge(share, without, with_) {
  let [out, within] = [without, with_];
  while (Math.abs(within - out) > EXACT_S) {
    const middle = (within + out) / 2;
    if (share(middle)) within = middle;
    else out = middle;
  }
  return within;
}

// Whether areas of rings have a place in common. Longitudes may be turns apart.
export function meets(rings, others) {
  const [first] = rings;
  const turned = others.map((ring) => {
    const turn = 360 * Math.round((first[0][0] - ring[0][0]) / 360);
    return turn ? ring.map(([lon, lat]) => [lon + turn, lat]) : ring;
  });
  if ([...rings, ...turned].flat().some(([, lat]) => Math.abs(lat) > MOST_LAT)) return false;
  const [box, box2] = [boxOf(rings), boxOf(turned)];
  if (box[0] > box2[2] || box2[0] > box[2] || box[1] > box2[3] || box2[1] > box[3]) return false;
  return turned.some((ring) => isWithin(ring[0], rings)) || rings.some((ring) => isWithin(ring[0], turned))
    || rings.some((ring) => turned.some((other) => cross(ring, other)));
}

function boxOf(rings) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const ring of rings) {
    for (const [lon, lat] of ring) {
      box[0] = Math.min(box[0], lon);
      box[1] = Math.min(box[1], lat);
      box[2] = Math.max(box[2], lon);
      box[3] = Math.max(box[3], lat);
    }
  }
  return box;
}

function isWithin([x, y], rings) {
  let inside = false;
  for (const ring of rings) {
    for (let n = 1; n < ring.length; n += 1) {
      const [[x0, y0], [x1, y1]] = [ring[n - 1], ring[n]];
      if ((y0 > y) !== (y1 > y) && x < x0 + ((y - y0) / (y1 - y0)) * (x1 - x0)) inside = !inside;
    }
  }
  return inside;
}

const sideOf = ([ax, ay], [bx, by], [cx, cy]) => (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);

function cross(ring, other) {
  for (let n = 1; n < ring.length; n += 1) {
    const [a, b] = [ring[n - 1], ring[n]];
    for (let m = 1; m < other.length; m += 1) {
      const [c, d] = [other[m - 1], other[m]];
      if (sideOf(a, b, c) * sideOf(a, b, d) <= 0 && sideOf(c, d, a) * sideOf(c, d, b) <= 0) return true;
    }
  }
  return false;
}

// Metres from the start of a track to where it is, in proportion between its points.
export function wayOf(motion) {
  const { points } = motion;
  const way = [0];
  for (let n = 1; n < points.length; n += 1) {
    way.push(way[n - 1] + metresBetween([points[n - 1].lon, points[n - 1].lat], [points[n].lon, points[n].lat]));
  }
  return (at) => {
    const t = motion.own(at);
    if (t <= points[0].t) return 0;
    const n = points.findIndex((point) => point.t >= t);
    if (n < 0) return way[way.length - 1];
    return way[n - 1] + ((t - points[n - 1].t) / (points[n].t - points[n - 1].t)) * (way[n] - way[n - 1]);
  };
}
