// The world as a square of size 1, in Web Mercator: x from 180 degrees west to east, y from north to south. And as a sphere.

export const RADIANS = Math.PI / 180;
export const SPHERE_M = 6371008.771415; // mean radius of WGS84, metres

export const mercatorX = (lon) => lon / 360 + 0.5;

export function mercatorY(lat) {
  return 0.5 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / (2 * Math.PI);
}

// The shorter way around, in units of the world and in degrees; exactly half a turn keeps its sign.
export const shortest = (turn) => (Math.abs(turn) > 0.5 ? turn - Math.round(turn) : turn);
export const shorter = (turn) => (Math.abs(turn) > 180 ? turn - 360 * Math.round(turn / 360) : turn);
