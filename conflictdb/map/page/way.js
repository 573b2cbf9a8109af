// Metres along the way of a track.

import { RADIANS, SPHERE_M } from "./world.js";

function metresBetween({ lon, lat }, { lon: lon2, lat: lat2 }) {
  const [half, across] = [Math.sin(((lat2 - lat) * RADIANS) / 2), Math.sin(((lon2 - lon) * RADIANS) / 2)];
  const share = half * half + Math.cos(lat * RADIANS) * Math.cos(lat2 * RADIANS) * across * across;
  return 2 * SPHERE_M * Math.asin(Math.min(1, Math.sqrt(share)));
}

// Metres from the start of a track to where it is, in proportion between its points.
export function wayOf(motion) {
  const { points } = motion;
  const way = [0];
  for (let n = 1; n < points.length; n += 1) way.push(way[n - 1] + metresBetween(points[n - 1], points[n]));
  return (at) => {
    const t = motion.own(at);
    if (t <= points[0].t) return 0;
    const n = points.findIndex((point) => point.t >= t);
    if (n < 0) return way[way.length - 1];
    return way[n - 1] + ((t - points[n - 1].t) / (points[n].t - points[n - 1].t)) * (way[n] - way[n - 1]);
  };
}
