// Both objects of a conflict at first contact, as they lie on the ground: an azimuthal equidistant view about the point of
// contact, true to scale also where Web Mercator is not, next to the poles.

import { drawn } from "./dom.js";
import { barLength, distance } from "./format.js";
import { RADIANS, SPHERE_M } from "./world.js";

const [WIDTH, HEIGHT, EDGE] = [320, 200, 24];

// East and north of a centre, metres along the great circle there.
export function seenFrom(centre, [lon, lat]) {
  const turn = (lon - centre[0]) * RADIANS;
  const [phi0, phi] = [centre[1] * RADIANS, lat * RADIANS];
  const east = Math.cos(phi) * Math.sin(turn);
  const half = Math.sin(turn / 2);
  const north = Math.sin(phi - phi0) + 2 * Math.sin(phi0) * Math.cos(phi) * half * half;
  const cosine = Math.sin(phi0) * Math.sin(phi) + Math.cos(phi0) * Math.cos(phi) * Math.cos(turn);
  const sine = Math.hypot(east, north);
  const m = sine > 0 ? (SPHERE_M * Math.atan2(sine, cosine)) / sine : 0;
  return [east * m, north * m];
}

// The rings of an object at an instant: a haven, or a footprint (GeoJSON); null if it is not there.
export function ringsOf(object, footprint, t) {
  if (object?.kind === "track") {
    const ring = object.motion.haven(t);
    return ring && [ring];
  }
  return footprint ? footprint.coordinates.flat() : null;
}

function size(rings) {
  return Math.max(0, ...rings.flat().map(([x, y]) => Math.hypot(x, y)));
}

export function plan(objects, footprints, contact, t) {
  const seen = objects.map((object, i) => ringsOf(object, footprints[i], t)?.map((ring) => ring.map((p) => seenFrom(contact, p))) ?? []);
  // As much as shows the smaller one whole, and where it touches the other.
  const sizes = seen.map(size).filter((m) => m > 0);
  const reach = Math.max(1, Math.min(...(sizes.length ? sizes : [1000])) * 1.15);
  const scale = (HEIGHT / 2 - EDGE) / reach;
  const at = ([x, y]) => `${(WIDTH / 2 + x * scale).toFixed(1)} ${(HEIGHT / 2 - y * scale).toFixed(1)}`;
  const shapes = seen.map((rings, i) => drawn("path", {
    class: `plan-${"ab"[i]}`, d: rings.map((ring) => `M${ring.map(at).join("L")}Z`).join(""),
  }));
  const bar = barLength(90 / scale);
  return drawn("svg", {
    class: "plan", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img",
    "aria-label": `Both at first contact, on the ground; the bar is ${distance(bar)} long`,
  },
  ...shapes,
  drawn("circle", { class: "plan-contact", cx: WIDTH / 2, cy: HEIGHT / 2, r: 4 }),
  drawn("path", { class: "plan-bar", d: `M12 ${HEIGHT - 12}v4h${(bar * scale).toFixed(1)}v-4` }),
  drawn("text", { x: 12, y: HEIGHT - 18 }, distance(bar)),
  drawn("path", { class: "plan-bar", d: `M${WIDTH - 16} ${HEIGHT - 8}v-22m-4 6l4 -6l4 6` }),
  drawn("text", { x: WIDTH - 16, y: HEIGHT - 36, "text-anchor": "middle" }, "N"));
}
