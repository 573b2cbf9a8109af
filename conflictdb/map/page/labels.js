// Names on the map, beside what they name: none on another one; where there is no room next to it, further away with a line.

import { colour, font } from "./theme.js";

const HALF_PX = 8; // of the height of a name
const EDGE_PX = 3;
const RINGS = [0, 26, 44, 66]; // how far from its place a name is tried; the first one is beside it
const WAYS = [[0, -1], [1, 0], [-1, 0], [0, 1], [0.8, -0.7], [-0.8, -0.7], [0.8, 0.7], [-0.8, 0.7]];
// [ring, way], beside the place first.
const PLACES = RINGS.flatMap((far, ring) => WAYS.slice(0, far === 0 ? 4 : WAYS.length).map((_, way) => [ring, way]));
const MOST_LED = 40; // names with a line: more are no help

const meets = (one, other) => one[0] < other[2] && other[0] < one[2] && one[1] < other[3] && other[1] < one[3];

// Boxes in a grid, so that a name is compared with those near it.
class Boxes {
  constructor(boxes) {
    this.cells = new Map();
    for (const box of boxes) this.add(box);
  }

  cellsOf([x0, y0, x1, y1]) {
    const found = [];
    for (let x = Math.floor(x0 / 64); x <= Math.floor(x1 / 64); x += 1) for (let y = Math.floor(y0 / 64); y <= Math.floor(y1 / 64); y += 1) found.push(x * 4096 + y);
    return found;
  }

  add(box) {
    for (const cell of this.cellsOf(box)) {
      if (!this.cells.has(cell)) this.cells.set(cell, []);
      this.cells.get(cell).push(box);
    }
  }

  hits(box) {
    return this.cellsOf(box).some((cell) => this.cells.get(cell)?.some((other) => meets(box, other)));
  }
}

// Pictures of names: text with a rim takes long to draw, and few names are new in a frame.
const pictures = new Map();
const MOST_PICTURES = 2000;

function pictureOf(text, ink, context, ratio) {
  const style = font("small");
  const name = [text, colour(ink), colour("sea"), style, ratio].join("\n");
  if (!pictures.has(name)) {
    if (pictures.size >= MOST_PICTURES) pictures.clear();
    context.font = style;
    const half = context.measureText(text).width / 2 + EDGE_PX;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [Math.ceil(2 * half * ratio), Math.ceil(2 * HALF_PX * ratio)];
    const own = canvas.getContext("2d", { willReadFrequently: true });
    own.scale(ratio, ratio);
    Object.assign(own, { font: style, textAlign: "center", textBaseline: "middle", lineJoin: "round", lineWidth: 3, strokeStyle: colour("sea"), fillStyle: colour(ink) });
    own.strokeText(text, half, HALF_PX);
    own.fillText(text, half, HALF_PX);
    pictures.set(name, { canvas, half });
  }
  return pictures.get(name);
}

// Writes names [{ key, text, ink, x, y, reach }], those that matter most first: above their place, or else around it, `reach`
// pixels away. `taken`: boxes without room. `places`: where each was written, by key, which it keeps while there is room. Returns
// the names that are written, { text, box, isLed }.
export function writeNames(context, names, taken, { width, height }, places = new Map()) {
  const ratio = context.getTransform().a;
  const boxes = new Boxes(taken);
  const written = [];
  let led = 0;
  for (const { key, text, ink, x, y, reach } of names) {
    const { canvas, half } = pictureOf(text, ink, context, ratio);
    const boxOf = ([ring, way]) => {
      const [across, down] = WAYS[way];
      const [cx, cy] = [x + across * (reach + RINGS[ring] + half), y + down * (reach + RINGS[ring] + HALF_PX + 1)];
      return [cx - half, cy - HALF_PX, cx + half, cy + HALF_PX];
    };
    const isFree = (box) => box[0] >= 0 && box[1] >= 0 && box[2] <= width && box[3] <= height && !boxes.hits(box);
    const before = places.get(key);
    const kept = before !== undefined && (before[0] === 0 || led < MOST_LED) && isFree(boxOf(before)) ? before : undefined;
    const place = kept ?? PLACES.find((one) => (one[0] === 0 || led < MOST_LED) && isFree(boxOf(one)));
    if (!place) continue;
    places.set(key, place);
    const box = boxOf(place);
    boxes.add(box);
    const isLed = place[0] > 0;
    written.push({ text, box, isLed });
    if (isLed) {
      led += 1;
      drawLine(context, x, y, box, ink);
    }
    context.drawImage(canvas, box[0], box[1], canvas.width / ratio, canvas.height / ratio);
  }
  return written;
}

// From a place to the nearest point of a box.
function drawLine(context, x, y, [x0, y0, x1, y1], ink) {
  context.strokeStyle = colour(ink);
  context.lineWidth = 1;
  const alpha = context.globalAlpha;
  context.globalAlpha = alpha * 0.6;
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(Math.min(x1, Math.max(x0, x)), Math.min(y1 - 2, Math.max(y0 + 2, y)));
  context.stroke();
  context.globalAlpha = alpha;
}
