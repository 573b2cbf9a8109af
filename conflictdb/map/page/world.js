// The world as a square of size 1, in Web Mercator: x from 180 degrees west to east, y from north to south.

export const mercatorX = (lon) => lon / 360 + 0.5;

export function mercatorY(lat) {
  return 0.5 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / (2 * Math.PI);
}

// The shorter way around.
export const shortest = (turn) => (Math.abs(turn) > 0.5 ? turn - Math.round(turn) : turn);
