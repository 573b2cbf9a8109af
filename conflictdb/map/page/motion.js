// Where havens are at an instant: sql/75_motion.sql, 76_great_circle_motion.sql and 77_havens.sql, formula by formula, so
// that the page can show any instant at once. Tests compare it with the kernel, and with conflictdb.havens.
//
// Rhumb lines: distance along the meridian is proportional to the rectifying latitude mu; a rhumb line is straight in
// (longitude, psi), psi = asinh(tan chi), chi the conformal latitude, and its length is linear in mu.

import { RADIANS, shorter, SPHERE_M } from "./world.js";

const RECTIFYING_M = 6367449.1458234153; // metres of meridian per radian of rectifying latitude

// Series of order 6 in the third flattening of WGS84 (Karney 2011, Snyder 1987): angle + sum c[j] sin(2 (j + 1) angle).
const MU_OF_LATITUDE = [
  -0.0025188279161202296627, 2.6435410598113799292e-6, -3.4526234225354141111e-9, 4.8918220519771715152e-12,
  -7.2287258683472357452e-15, 1.0958479860708544708e-17,
];
const LATITUDE_OF_MU = [
  0.0025188265843977032707, 3.700949035657531109e-6, 7.4477702699759963203e-9, 1.7035857112600327458e-11,
  4.178161827657265913e-14, 1.0706431174734805386e-16,
];
const CHI_OF_MU = [
  -0.00083773216405794868232, -5.9058701522202033771e-8, -1.6734826652839967562e-10, -2.1647980400627058961e-13,
  -3.7879780461686052188e-16, -7.2487488906941543992e-19,
];

function series(angle, coefficients) {
  let sum = 0;
  for (let j = coefficients.length; j >= 1; j -= 1) sum += coefficients[j - 1] * Math.sin(2 * j * angle);
  return angle + sum;
}

// Each earth: radius of the meridian (metres per radian of mu), and its series; a sphere needs none.
const EARTHS = {
  wgs84: { m: RECTIFYING_M, mu: MU_OF_LATITUDE, latitude: LATITUDE_OF_MU, chi: CHI_OF_MU },
  sphere: { m: SPHERE_M, mu: [], latitude: [], chi: [] },
};

// (psi2 - psi1) / (mu2 - mu1) between two rectifying latitudes, also where they are equal.
function stretch(from, to, earth) {
  const way = to - from;
  let ratio = 0;
  for (let j = earth.chi.length; j >= 1; j -= 1) {
    ratio += 2 * earth.chi[j - 1] * Math.cos(j * (from + to)) * (way === 0 ? j : Math.sin(j * way) / way);
  }
  ratio += 1;
  const chi1 = series(from, earth.chi);
  const chi2 = series(to, earth.chi);
  const cosine = Math.cos((chi1 + chi2) / 2);
  const sine = Math.sin((ratio * way) / 2) / cosine;
  if (sine === 0) return ratio / cosine;
  if (Math.abs(way) > 0.5) return (Math.asinh(Math.tan(chi2)) - Math.asinh(Math.tan(chi1))) / way;
  return (2 * Math.atanh(sine)) / way;
}

// A leg: t0, t1 (seconds), at(share, outline): [[lon, lat], …] degrees, longitudes not wrapped; outline in metres, null
// for the reference point alone.
function rhumbLegs(points, earth) {
  const mu = points.map((p) => series(p.lat * RADIANS, earth.mu));
  const legs = [];
  for (let i = 0; i + 1 < points.length; i += 1) {
    const turn = shorter(points[i + 1].lon - points[i].lon);
    const way = mu[i + 1] - mu[i];
    const whole = stretch(mu[i], mu[i + 1], earth);
    const moves = turn !== 0 || way !== 0;
    legs.push({ i, turn, way, whole, bearing: moves ? Math.atan2((turn * RADIANS) / whole, way) : null });
  }
  let kept = legs.find((leg) => leg.bearing !== null)?.bearing ?? 0;
  return legs.map(({ i, turn, way, whole, bearing }) => {
    kept = bearing ?? kept;
    const heading = kept;
    const [sine, cosine] = [Math.sin(heading), Math.cos(heading)];
    return {
      bearing: heading,
      t0: points[i].t,
      t1: points[i + 1].t,
      at(share, outline) {
        const m = mu[i] + share * way;
        const lon = points[i].lon + (turn * share * stretch(mu[i], m, earth)) / whole;
        if (outline === null) return [[lon, series(m, earth.latitude) / RADIANS]];
        // Each by two rhumb steps: ahead along the heading, then to starboard across it.
        return outline.map(([x, y]) => {
          const [ahead, across] = [y / earth.m, x / earth.m];
          const mu1 = m + ahead * cosine;
          const mu2 = mu1 - across * sine;
          const east = ahead * sine * stretch(m, mu1, earth) + across * cosine * stretch(mu1, mu2, earth);
          return [lon + east / RADIANS, series(mu2, earth.latitude) / RADIANS];
        });
      },
    };
  });
}

const mixed = (a, s, b, t) => [a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function degreesOf([x, y, z]) {
  return [Math.atan2(y, x) / RADIANS, Math.atan2(z, Math.hypot(x, y)) / RADIANS];
}

function circleLegs(points) {
  const legs = [];
  for (let i = 0; i + 1 < points.length; i += 1) {
    const [lon, lat] = [points[i].lon * RADIANS, points[i].lat * RADIANS];
    const turn = (points[i + 1].lon - points[i].lon) * RADIANS;
    const next = points[i + 1].lat * RADIANS;
    // East and north to go, times the sine of the length: from differences, so that short legs keep their digits.
    const east = Math.cos(next) * Math.sin(turn);
    const half = Math.sin((turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI))) / 2);
    const north = Math.sin(next - lat) + 2 * Math.sin(lat) * Math.cos(next) * half * half;
    const cosine = Math.sin(lat) * Math.sin(next) + Math.cos(lat) * Math.cos(next) * Math.cos(turn);
    const sine = Math.hypot(east, north);
    const toEast = [-Math.sin(lon), Math.cos(lon), 0];
    const toNorth = [-Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat)];
    legs.push({
      start: [Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat)],
      heading: sine > 0 ? mixed(toEast, east / sine, toNorth, north / sine) : null,
      angle: sine > 0 ? Math.atan2(sine, cosine) : 0,
      toNorth, toEast,
    });
  }
  const first = legs.find((leg) => leg.heading)?.heading ?? null;
  let kept = null;
  return legs.map(({ start, heading, angle, toNorth, toEast }, i) => {
    const along = heading ?? kept ?? first ?? toNorth;
    if (heading) kept = mixed(heading, Math.cos(angle), start, -Math.sin(angle));
    const side = [
      along[1] * start[2] - along[2] * start[1],
      along[2] * start[0] - along[0] * start[2],
      along[0] * start[1] - along[1] * start[0],
    ];
    return {
      bearing: Math.atan2(dot(along, toEast), dot(along, toNorth)),
      t0: points[i].t,
      t1: points[i + 1].t,
      at(share, outline) {
        const centre = angle * share;
        const middle = degreesOf(mixed(start, Math.cos(centre), along, Math.sin(centre)));
        if (outline === null) return [middle];
        return outline.map(([x, y]) => {
          const ahead = centre + y / SPHERE_M;
          const place = mixed(start, Math.cos(ahead), along, Math.sin(ahead));
          const [lon, lat] = degreesOf(mixed(place, Math.cos(x / SPHERE_M), side, Math.sin(x / SPHERE_M)));
          return [middle[0] + shorter(lon - middle[0]), lat];
        });
      },
    };
  });
}

const legsOf = (points, scene) => (scene.motion === "great_circle" ? circleLegs(points) : rhumbLegs(points, EARTHS[scene.earth]));

// The bearing of each leg at its start, degrees.
export const bearingsOf = (points, scene) => legsOf(points, scene).map(({ bearing }) => bearing / RADIANS);

// An outline (metres) whose sides all moved outward, corners mitred; a point is a square of size 0, a line a rectangle.
function grown(outline, byM) {
  const corners = outline.slice(0, -1).filter(([x, y], i, all) => {
    const [px, py] = all[(i + all.length - 1) % all.length];
    return x !== px || y !== py;
  });
  if (corners.length <= 2) {
    const a = corners[0] ?? outline[0];
    const b = corners[1] ?? a;
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    const [u, v] = length > 0 ? [(b[0] - a[0]) / length, (b[1] - a[1]) / length] : [0, 1];
    const ring = [[-1, 1], [1, 1], [1, -1], [-1, -1]].map(([along, side]) => {
      const end = along < 0 ? a : b;
      return [end[0] + (along * u + side * v) * byM, end[1] + (along * v - side * u) * byM];
    });
    return [...ring, ring[0]];
  }
  const n = corners.length;
  let doubled = 0;
  corners.forEach(([x, y], i) => {
    const [nx, ny] = corners[(i + 1) % n];
    doubled += x * ny - y * nx;
  });
  const way = doubled < 0 ? -1 : 1;
  const normals = corners.map(([x, y], i) => {
    const [nx, ny] = corners[(i + 1) % n];
    const length = Math.hypot(nx - x, ny - y);
    return [(way * (ny - y)) / length, (-way * (nx - x)) / length];
  });
  const ring = corners.map(([x, y], i) => {
    const [u, v] = normals[i];
    const [bu, bv] = normals[(i + n - 1) % n];
    const share = byM / (1 + u * bu + v * bv);
    return [x + (u + bu) * share, y + (v + bv) * share];
  });
  return [...ring, ring[0]];
}

function between(from, to, share) {
  return from.map(([x, y], i) => [x + share * (to[i][0] - x), y + share * (to[i][1] - y)]);
}

// How many of some spans, in order, have begun at an instant.
export function begun(spans, t) {
  let [low, high] = [0, spans.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (spans[middle][0] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

// What havens of one track are computed from. points: {lon, lat, t} degrees and seconds; outline: a ring in metres
// (starboard, ahead); outlines: one for each point, or null; grow: metres per second; departures: seconds, of the voyages,
// which do not overlap; null: one voyage, at the times of the points.
export class Motion {
  constructor(points, outline, grow, outlines, scene, departures = null) {
    this.points = points;
    const lasts = points[points.length - 1].t - points[0].t;
    this.spans = departures && departures.map((at) => [at, at + lasts]);
    this.start = departures ? departures[0] ?? Infinity : points[0].t;
    this.end = departures ? (departures[departures.length - 1] ?? -Infinity) + lasts : points[points.length - 1].t;
    this.outline = outline;
    this.grow = grow;
    this.outlines = outlines;
    this.scene = scene;
    this.legs = null; // made when they are first needed: of most tracks of a large scene nothing but points is shown
    this.hint = 0;
    const widest = Math.max(...(outlines ?? [outline]).flat().map(([x, y]) => Math.hypot(x, y)));
    this.reachM = widest + 2 * grow * lasts;
  }

  // The time of the points at an instant: that of the last voyage that has begun.
  own(t) {
    const { spans, points } = this;
    if (!spans) return t;
    const n = begun(spans, t);
    return n ? t - spans[n - 1][0] + points[0].t : -Infinity;
  }

  // The number of the leg at an instant, -1 when the track is not under way. The last instant belongs to none.
  legAt(at) {
    const { points } = this;
    const t = this.own(at);
    if (!(t >= points[0].t && t < points[points.length - 1].t)) return -1;
    let i = this.hint;
    if (!(t >= points[i].t && t < points[i + 1].t)) {
      let [low, high] = [0, points.length - 1];
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (points[middle].t <= t) low = middle;
        else high = middle;
      }
      i = low;
    }
    this.hint = i;
    return i;
  }

  leg(i) {
    this.legs ??= legsOf(this.points, this.scene);
    return this.legs[i];
  }

  // Where the reference point is: [lon, lat], null when the track is not under way.
  place(t) {
    const i = this.legAt(t);
    if (i < 0) return null;
    const leg = this.leg(i);
    return leg.at((this.own(t) - leg.t0) / (leg.t1 - leg.t0), null)[0];
  }

  // The haven: a ring [[lon, lat], …], degrees, not wrapped; null when the track is not under way.
  haven(at) {
    const i = this.legAt(at);
    if (i < 0) return null;
    const t = this.own(at);
    const leg = this.leg(i);
    const share = (t - leg.t0) / (leg.t1 - leg.t0);
    let { outline } = this;
    if (this.outlines) outline = between(this.outlines[i], this.outlines[i + 1], share);
    else if (this.grow > 0) outline = grown(outline, this.grow * (t - this.points[0].t));
    return leg.at(share, outline);
  }
}
