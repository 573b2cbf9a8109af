// All of a large scene from afar: areas, paths and first contacts, drawn on a canvas above the map from numbers that the page
// holds. Shapes are true to a pixel up to the zoom from which tiles are shown (map.js).
//
// On a canvas in memory rather than by WebGL: without a graphics card that takes 20 microseconds for each triangle.

import { colour, theme } from "./theme.js";
import { mercatorX, mercatorY } from "./world.js";

// What an object or conflict looks like, from below to above: dimmed while others are chosen, off, on, or chosen (of objects
// the first or second).
const LOOKS = ["dim", "off", "on", "chosen", "a", "b"];
const HIDDEN = LOOKS.length;
// As map.js has it for tiles.
const COLOURS = ["object", "object", "object", "object", "a", "b"];
const AREA_OPACITY = [0.02, 0.03, 0.14, 0.2, 0.2, 0.2];
const EDGE_OPACITY = [0.15, 0.25, 0.75, 1, 1, 1];
const PATH_OPACITY = [0.08, 0.12, 0.4, 1, 1, 1];
const LINE_PX = [1, 1, 1, 2.5, 2.5, 2.5];
const CONTACT_OPACITY = [0.15, 0.4, 0.9, 1];
const CONTACT_PX = [2.5, 2.5, 2.5, 5];
const TOGETHER = 50; // shapes of a path: of thousands in one, the time grows with the square
const SPECK_PX = 1.5; // what is smaller is a point
const STEP_PX = 0.7; // points of a line that are nearer than this are left out
const CLICK_PX = 5;
const FURTHEST_LAT = 86; // degrees: Web Mercator ends before it
const [NORTH, SOUTH] = [mercatorY(FURTHEST_LAT), mercatorY(-FURTHEST_LAT)];

// Lines of many objects, in units of the world. Object n has lines objects[n] to objects[n + 1] (not included), line m the
// points lines[m] to lines[m + 1]; boxes has west, north, east, south of each object.
class Lines {
  constructor() {
    this.places = [];
    this.lines = [0];
    this.objects = [0];
    this.boxes = [];
  }

  // numbers: x and y in turn.
  addLine(numbers) {
    for (const number of numbers) this.places.push(number);
    this.lines.push(this.places.length / 2);
  }

  endObject() {
    let [west, north, east, south] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let i = 2 * this.lines[this.objects[this.objects.length - 1]]; i < this.places.length; i += 2) {
      west = Math.min(west, this.places[i]);
      east = Math.max(east, this.places[i]);
      north = Math.min(north, this.places[i + 1]);
      south = Math.max(south, this.places[i + 1]);
    }
    this.boxes.push(west, north, east, south);
    this.objects.push(this.lines.length - 1);
  }

  packed() {
    this.places = Float64Array.from(this.places);
    this.boxes = Float64Array.from(this.boxes);
    return this;
  }
}

export class Overview {
  // `isShown` says whether it is this that shows the scene, or tiles.
  constructor(canvas, view, isShown) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { willReadFrequently: true });
    this.view = view;
    this.isShown = isShown;
    this.kinds = []; // [{objects, shapes, looks}] of areas and paths
    this.conflicts = [];
    this.marks = 0; // how often something else was to be shown
    this.drawn = "";
    view.map.on("render", () => this.draw());
    theme.onChange(() => {
      this.marks += 1;
      this.draw();
    });
  }

  // areas: [{object, rings}], rings of longitudes and latitudes in turn (degrees); paths: [{object, line}], x and y in turn
  // (units of the world, without jumps).
  take(areas, paths) {
    const outlines = new Lines();
    for (const { rings } of areas) {
      for (const ring of rings) outlines.addLine(ring.map((degrees, i) => (i % 2 ? bounded(mercatorY(degrees)) : mercatorX(degrees))));
      outlines.endObject();
    }
    const lines = new Lines();
    for (const { line } of paths) {
      lines.addLine(line.map((number, i) => (i % 2 ? bounded(number) : number)));
      lines.endObject();
    }
    this.kinds = [[areas, outlines], [paths, lines]].map(([all, shapes]) => ({
      objects: all.map(({ object }) => object), shapes: shapes.packed(), looks: new Uint8Array(all.length),
    }));
    this.marks += 1;
  }

  // Each is a point at first contact, or in the middle of the region where that is not known.
  takeConflicts(conflicts) {
    this.conflicts = conflicts;
    this.contacts = Float64Array.from(conflicts.flatMap(({ lon, lat, west, south, east, north }) => (
      lon !== null ? [mercatorX(lon), mercatorY(lat)]
        : west !== null ? [mercatorX((west + east) / 2), mercatorY((south + north) / 2)] : [NaN, NaN])));
    this.contactLooks = new Uint8Array(conflicts.length);
    this.marks += 1;
  }

  // Shows what is on and chosen; `flagsOf` is asked of each object and conflict (state.js).
  mark(flagsOf) {
    const look = (one) => {
      const { on, hidden, chosen, dim, a, b } = flagsOf(one);
      return hidden ? HIDDEN : LOOKS.indexOf(a ? "a" : b ? "b" : chosen ? "chosen" : dim ? "dim" : on ? "on" : "off");
    };
    let isSame = true;
    const put = (looks, n, now) => {
      isSame &&= looks[n] === now;
      looks[n] = now;
    };
    for (const { objects, looks } of this.kinds) objects.forEach((object, n) => put(looks, n, look(object)));
    this.conflicts.forEach((one, n) => put(this.contactLooks, n, look(one)));
    if (!isSame) this.marks += 1;
    this.draw();
  }

  draw() {
    const frame = this.view.frame();
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(frame.width * ratio), Math.round(frame.height * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    const { context } = this;
    // What is drawn stays, until it is of another view, or something else is on.
    const drawn = this.kinds.length && this.isShown() ? JSON.stringify([frame, ratio, this.marks]) : "";
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, frame.width, frame.height);
    if (!drawn) return;
    for (const look of LOOKS.keys()) {
      context.fillStyle = context.strokeStyle = colour(COLOURS[look]);
      context.lineWidth = LINE_PX[look];
      this.kinds.forEach((kind, n) => this.drawKind(kind, look, frame, n === 0 ? AREA_OPACITY[look] : 0, [EDGE_OPACITY, PATH_OPACITY][n][look]));
    }
    this.drawContacts(frame, ratio);
  }

  // Objects of one look, some at a time: filled if that is to be seen, and their lines.
  drawKind({ shapes, looks }, look, frame, fill, stroke) {
    const { context } = this;
    const { boxes, objects } = shapes;
    const [right, bottom] = [frame.left + frame.width / frame.size, frame.top + frame.height / frame.size];
    let together = 0;
    const paint = () => {
      if (!together) return;
      if (fill) {
        context.globalAlpha = fill;
        context.fill();
      }
      context.globalAlpha = stroke;
      context.stroke();
      together = 0;
    };
    for (let n = 0; n < looks.length; n += 1) {
      const [west, north, east, south] = [boxes[4 * n], boxes[4 * n + 1], boxes[4 * n + 2], boxes[4 * n + 3]];
      if (looks[n] !== look || south < frame.top || north > bottom) continue;
      // On each turn of the world that is in view.
      for (let turn = Math.ceil(frame.left - east); west + turn < right; turn += 1) {
        if (Math.max(east - west, south - north) * frame.size < SPECK_PX) {
          context.globalAlpha = stroke;
          context.fillRect((west + turn - frame.left) * frame.size, (north - frame.top) * frame.size, 1, 1);
          continue;
        }
        if (!together) context.beginPath();
        for (let m = objects[n]; m < objects[n + 1]; m += 1) this.trace(shapes, m, frame, turn);
        together += 1;
        if (together === TOGETHER) paint();
      }
    }
    paint();
  }

  trace({ places, lines }, m, { left, top, size }, turn) {
    const { context } = this;
    const last = lines[m + 1] - 1;
    let [beforeX, beforeY] = [Infinity, Infinity];
    for (let i = lines[m]; i <= last; i += 1) {
      const x = (places[2 * i] + turn - left) * size;
      const y = (places[2 * i + 1] - top) * size;
      if (i === lines[m]) context.moveTo(x, y);
      else if (i === last || Math.abs(x - beforeX) + Math.abs(y - beforeY) > STEP_PX) context.lineTo(x, y);
      else continue;
      [beforeX, beforeY] = [x, y];
    }
  }

  // First contacts: copies of one dot, pixel by pixel, since there may be a hundred thousand.
  drawContacts(frame, ratio) {
    const { width, height } = this.canvas;
    const image = new ImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    for (const look of CONTACT_PX.keys()) {
      const [current, stale] = [true, false].map((isCurrent) => dotOf(CONTACT_PX[look] * ratio, ratio, CONTACT_OPACITY[look], isCurrent));
      for (let n = 0; n < this.conflicts.length; n += 1) {
        if (this.contactLooks[n] !== look) continue;
        const dot = this.conflicts[n].is_current ? current : stale;
        const y = Math.round((this.contacts[2 * n + 1] - frame.top) * frame.size * ratio);
        if (!(y > -dot.reach && y < height + dot.reach)) continue;
        const from = this.contacts[2 * n] - frame.left;
        for (let x = (from - Math.floor(from)) * frame.size * ratio; x < width + dot.reach; x += frame.size * ratio) {
          stamp(pixels, width, height, dot, Math.round(x), y);
        }
      }
    }
    this.dots ??= document.createElement("canvas");
    Object.assign(this.dots, { width, height });
    this.dots.getContext("2d").putImageData(image, 0, 0);
    this.context.setTransform(1, 0, 0, 1, 0, 0);
    this.context.globalAlpha = 1;
    this.context.drawImage(this.dots, 0, 0);
  }

  // The conflicts whose first contact is at a pixel, the nearest first.
  conflictsAt({ x, y }) {
    const { left, top, size } = this.view.frame();
    const found = [];
    this.conflicts.forEach(({ id }, n) => {
      const across = this.contacts[2 * n] - left - x / size;
      const far = Math.hypot(across - Math.round(across), this.contacts[2 * n + 1] - top - y / size) * size;
      if (far <= CLICK_PX && this.contactLooks[n] !== HIDDEN) found.push({ id, far });
    });
    return found.sort((a, b) => a.far - b.far).map(({ id }) => id);
  }
}

const bounded = (y) => Math.min(SOUTH, Math.max(NORTH, y));

// A disc with a rim as its pixels: places about the middle, and colours; a ring for what is not current.
function dotOf(radius, rim, opacity, isCurrent) {
  const reach = Math.ceil(radius + rim);
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 2 * reach + 1;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const disc = (size, fill, alpha) => {
    context.globalAlpha = alpha;
    context.fillStyle = fill;
    context.beginPath();
    context.arc(reach + 0.5, reach + 0.5, size, 0, 2 * Math.PI);
    context.fill();
  };
  disc(radius + rim, colour(isCurrent ? "paper" : "conflict"), opacity);
  context.globalCompositeOperation = "copy";
  context.save();
  context.beginPath();
  context.arc(reach + 0.5, reach + 0.5, radius, 0, 2 * Math.PI);
  context.clip();
  disc(radius, colour(isCurrent ? "conflict" : "paper"), opacity);
  context.restore();
  const { data } = context.getImageData(0, 0, canvas.width, canvas.width);
  const colours = new Uint32Array(data.buffer);
  const pixels = [];
  colours.forEach((value, i) => {
    const alpha = Math.round(data[4 * i + 3]);
    const [x, y] = [(i % canvas.width) - reach, Math.floor(i / canvas.width) - reach];
    if (alpha > 0) pixels.push({ x, y, value, isFull: Math.hypot(x, y) <= radius });
  });
  return { reach, pixels };
}

function stamp(pixels, width, height, dot, x, y) {
  for (const pixel of dot.pixels) {
    const [column, row] = [x + pixel.x, y + pixel.y];
    if (column < 0 || row < 0 || column >= width || row >= height) continue;
    const at = row * width + column;
    if (pixel.isFull || pixels[at] === 0) pixels[at] = pixel.value;
  }
}
