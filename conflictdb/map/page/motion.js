// Where havens are at an instant. The kernel computes it (kernel.js); the page finds the leg and the voyage.

import { shorter } from "./world.js";

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

const FEW = 16; // legs whose scene is made anew

// The earth as the kernel has it: the plane of a scene (bytes of a KernelPlane).
export class Ground {
  // plane: base64.
  static of(kernel, plane) {
    return new Ground(kernel, Uint8Array.from(atob(plane), (sign) => sign.charCodeAt(0)));
  }

  constructor(kernel, plane) {
    Object.assign(this, { kernel, plane });
    // Scenes of the last legs: the next picture has the same ones.
    this.held = { havens: { legs: [], scene: null }, places: { legs: [], scene: null } };
  }

  // The scene of some legs, for havens or for places.
  sceneOf(legs, name) {
    const { kernel } = this;
    const held = this.held[name];
    if (held.scene === null || held.legs.length !== legs.length || held.legs.some((leg, n) => leg !== legs[n])) {
      if (held.scene !== null) kernel.free(held.scene);
      held.scene = null;
      held.scene = kernel.sceneOf(piecesOf(this.plane, legs));
      held.legs = legs;
    }
    return held.scene;
  }

  // The heading of each leg of some points at its start, degrees.
  headings(points) {
    return this.kernel.headings(this.plane, Float64Array.from(points.flatMap(({ lon, lat }) => [lon, lat])));
  }

  // Havens of motions at an instant each, as [motion, t]: rings [[lon, lat], …], degrees, which run on across the date line; null
  // where one is not under way, or the kernel does not know it.
  havens(asked) {
    return this.positions(asked, "havens", (scene, rows) => this.kernel.positions(scene, rows));
  }

  // Reference points likewise: [lon, lat].
  places(asked) {
    return this.positions(asked, "places", (scene, rows) => this.kernel.references(scene, rows)).map((ring) => ring && ring[0]);
  }

  positions(asked, name, of) {
    const found = asked.map(() => null);
    const legs = asked.flatMap(([motion, at], n) => {
      const i = motion.legAt(at);
      return i < 0 ? [] : [{ n, leg: motion.leg(i), seconds: motion.own(at) - motion.points[i].t }];
    });
    if (!legs.length) return found;
    const sizes = legs.map(({ leg }) => leg.from.length / 2);
    const slots = Math.max(...sizes);
    const ask = (scene) => of(scene, { piece: BigInt64Array.from(legs, (_, row) => BigInt(row)), at: Float64Array.from(legs, ({ seconds }) => seconds), slots });
    const own = legs.map(({ leg }) => leg);
    const all = own.length < FEW ? this.kernel.withScene(piecesOf(this.plane, own), null, ask) : ask(this.sceneOf(own, name));
    const degrees = this.kernel.degrees(this.plane, all);
    const count = legs.length;
    legs.forEach(({ n }, row) => {
      const [lon0, lat0] = [degrees[2 * row], degrees[2 * row + 1]];
      if (Number.isNaN(lon0 + lat0)) return;
      const vertices = all.length === 2 * count ? 1 : sizes[row];
      const ring = [[lon0, lat0]];
      for (let k = 1; k < vertices; k += 1) {
        const at = 2 * (k * count + row);
        ring.push([lon0 + shorter(degrees[at] - lon0), degrees[at + 1]]);
      }
      ring.push(ring[0]);
      found[n] = ring;
    });
    return found;
  }

  // Places of a leg in so many equal parts, without its ends: [[lon, lat], …].
  along(leg, parts) {
    const shares = Array.from({ length: parts - 1 }, (_, n) => (n + 1) / parts);
    if (!shares.length) return [];
    const xy = this.kernel.withScene(piecesOf(this.plane, [leg]), null, (scene) => this.kernel.references(scene, {
      piece: new BigInt64Array(shares.length), at: Float64Array.from(shares, (share) => share * leg.lasts), slots: 1,
    }));
    const degrees = this.kernel.degrees(this.plane, xy);
    return shares.map((_, n) => [degrees[2 * n], degrees[2 * n + 1]]);
  }

  // The corners of an outline [[x, y], …] and their rates, when every side moves outward at speed 1: { corner, rate }.
  mitred(outline) {
    return this.kernel.mitred(Float64Array.from(outline.flat()));
  }
}

// Whole legs as pieces that the kernel takes. Instants count from the start of each leg.
function piecesOf(plane, legs) {
  const count = legs.length;
  const ends = BigInt64Array.from(legs, ({ lasts }) => BigInt(Math.round(1e6 * lasts)));
  const nothing = new BigInt64Array(count);
  const offset = new BigInt64Array(count + 1);
  let vertices = 0;
  legs.forEach(({ from }, n) => { offset[n + 1] = BigInt(vertices += from.length / 2); });
  const [shape, shapeTo] = [new Float64Array(2 * vertices), legs.some(({ to }) => to) ? new Float64Array(2 * vertices) : null];
  const [start, end] = [new Float64Array(2 * count), new Float64Array(2 * count)];
  legs.forEach((leg, n) => {
    const at = 2 * Number(offset[n]);
    shape.set(leg.from, at);
    shapeTo?.set(leg.to ?? leg.from, at);
    start.set(leg.start, 2 * n);
    end.set(leg.end, 2 * n);
  });
  return {
    plane, moves: new Int8Array(count).fill(1), turn: new Int16Array(count), start_us: nothing, end_us: ends, leg_start_us: nothing, leg_end_us: ends,
    leg_start_deg: start, leg_end_deg: end, bearing_deg: Float64Array.from(legs, ({ bearing }) => bearing), shape_offset: offset, shape, shape_to: shapeTo,
  };
}

const flat = (ring) => Float64Array.from(ring.slice(0, -1).flat());

// What havens of one track are computed from. points: {lon, lat, t} degrees and seconds; outline: a closed ring in metres
// (starboard, ahead); outlines: one for each point, or null; grow: metres per second; departures: seconds, of the voyages,
// which do not overlap; null: one voyage, at the times of the points; ground: where it moves; scene: its settings.
export class Motion {
  constructor(points, outline, grow, outlines, scene, departures = null, ground = scene.ground) {
    this.points = points;
    const lasts = points[points.length - 1].t - points[0].t;
    this.departures = departures;
    this.spans = departures && departures.map((at) => [at, at + lasts]);
    this.start = departures ? departures[0] ?? Infinity : points[0].t;
    this.end = departures ? (departures[departures.length - 1] ?? -Infinity) + lasts : points[points.length - 1].t;
    this.outline = outline;
    this.grow = grow;
    this.outlines = outlines;
    this.scene = scene;
    this.ground = ground;
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

  // A leg: ends in degrees, the longitude running on, how long it lasts (seconds), heading, and outlines at both ends (to: null if
  // it keeps that).
  leg(i) {
    this.legs ??= this.made();
    return this.legs[i];
  }

  made() {
    const { points, outline, outlines, grow, ground } = this;
    const bearings = ground.headings(points);
    const mitres = grow > 0 ? ground.mitred(outline.slice(0, -1)) : null;
    const grown = (t) => mitres.corner.map((m, n) => m + mitres.rate[n] * grow * (t - points[0].t));
    return points.slice(0, -1).map((point, i) => {
      const next = points[i + 1];
      return {
        start: [point.lon, point.lat], end: [point.lon + shorter(next.lon - point.lon), next.lat], lasts: next.t - point.t, bearing: bearings[i],
        from: mitres ? grown(point.t) : flat(outlines ? outlines[i] : outline), to: mitres ? grown(next.t) : outlines ? flat(outlines[i + 1]) : null,
      };
    });
  }

  // Where the reference point is: [lon, lat], null when the track is not under way.
  place(t) {
    return this.ground.places([[this, t]])[0];
  }

  // The haven: a closed ring [[lon, lat], …], degrees, null when the track is not under way.
  haven(t) {
    return this.ground.havens([[this, t]])[0];
  }

  // Places of a leg in so many equal parts, without its ends.
  along(i, parts) {
    return this.ground.along(this.leg(i), parts);
  }
}
