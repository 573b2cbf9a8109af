// The chosen pair on the map: its overlap now, where its tracks are at first and last contact, its letters and names.

import { clock, labelOf } from "./format.js";
import { isThere } from "./model.js";
import { colour, font } from "./theme.js";
import { mercatorX, mercatorY } from "./world.js";

const SIDES = ["a", "b"];
const MARGIN_PX = 12; // of labels from the edge of the map
const LABEL_PX = 16; // height of a label

export class Focus {
  constructor(conflict, model) {
    this.objects = [conflict.a, conflict.b].map((key) => model.objects.get(key));
    this.overlaps = model.scene.separation_m === 0 && conflict.verdict === "conflict";
    this.contacts = [["first", conflict.start], ["last", conflict.end]].filter(([, t]) => Number.isFinite(t));
    this.shapes = [null, null]; // of areas: rings of x and y in turn (units of the world), once they are known
  }

  // footprints: GeoJSON of areas by key.
  takeFootprints(footprints) {
    this.shapes = this.objects.map((object) => {
      const { type, coordinates } = (object && footprints[object.key]) ?? {};
      const polygons = { Polygon: [coordinates], MultiPolygon: coordinates }[type];
      return polygons ? polygons.flat().map(worldRing) : null;
    });
  }

  // Rings of an object at an instant; null where it is not there, or not known.
  ringsAt(n, t) {
    const object = this.objects[n];
    if (!object || !isThere(object, t)) return null;
    if (object.kind === "area") return this.shapes[n];
    const ring = object.motion.haven(t) ?? object.motion.haven(t - 1e-6); // the last instant belongs to no leg
    return ring && [worldRing(ring)];
  }

  // Draws all but the havens; returns the boxes of its labels.
  draw(context, frame, t) {
    if (this.overlaps) this.drawOverlap(context, frame, t);
    this.drawGhosts(context, frame);
    const taken = this.drawNames(context, frame, t);
    this.drawContacts(context, frame, taken);
    return taken;
  }

  drawOverlap(context, frame, t) {
    const [a, b] = [this.ringsAt(0, t), this.ringsAt(1, t)];
    if (!a || !b) return;
    context.save();
    trace(context, frame, a);
    context.clip("evenodd");
    trace(context, frame, b);
    context.fillStyle = colour("conflict");
    context.globalAlpha = 0.8;
    context.fill("evenodd");
    context.restore();
  }

  drawGhosts(context, frame) {
    context.save();
    context.lineWidth = 1;
    context.setLineDash([2, 3]);
    this.objects.forEach((object, n) => {
      if (object?.kind !== "track") return;
      context.strokeStyle = colour(SIDES[n]);
      for (const [, t] of this.contacts) {
        trace(context, frame, this.ringsAt(n, bounded(t, object.start, object.end)) ?? []);
        context.stroke();
      }
    });
    context.restore();
  }

  // Both names are in view wherever the objects are.
  drawNames(context, frame, t) {
    const taken = [];
    context.save();
    context.font = font("small", 600);
    this.objects.forEach((object, n) => {
      const place = object && isThere(object, t) ? (object.kind === "area" ? object.inside : object.motion.place(t)) : null;
      if (!place) return;
      const text = `${SIDES[n].toUpperCase()} · ${labelOf(object)}`;
      const half = context.measureText(text).width / 2 + 3;
      const [x, y] = pixelOf(frame, place);
      const at = [bounded(x, half + MARGIN_PX, frame.width - half - MARGIN_PX), bounded(y - LABEL_PX, MARGIN_PX, frame.height - 3 * MARGIN_PX)];
      if (taken.some((box) => meets(box, boxAt(at, half)))) {
        const [, top, , bottom] = taken[0];
        at[1] = at[1] > frame.height / 2 ? top - LABEL_PX / 2 : bottom + LABEL_PX / 2;
      }
      taken.push(boxAt(at, half));
      write(context, text, at, `${SIDES[n]}-ink`);
    });
    context.restore();
    return taken;
  }

  // The times of first and last contact, at the ghosts, where there is room.
  drawContacts(context, frame, taken) {
    const track = this.objects.find((object) => object?.kind === "track");
    context.save();
    context.font = font("small");
    for (const [name, t] of track ? this.contacts : []) {
      const at = bounded(t, track.start, track.end);
      const place = track.motion.place(at) ?? track.motion.place(at - 1e-6);
      if (!place) continue;
      const text = `${name} ${clock(name === "last" ? Math.ceil(t) : t)}`; // outward, as in the card
      const half = context.measureText(text).width / 2 + 3;
      const [x, y] = pixelOf(frame, place);
      const box = boxAt([x, y + LABEL_PX], half);
      if (taken.some((other) => meets(other, box))) continue;
      taken.push(box);
      write(context, text, [x, y + LABEL_PX], "ink-soft");
    }
    context.restore();
  }
}

const bounded = (value, low, high) => Math.max(low, Math.min(high, value));
const boxAt = ([x, y], half) => [x - half, y - LABEL_PX / 2, x + half, y + LABEL_PX / 2];
const meets = (one, other) => one[0] < other[2] && other[0] < one[2] && one[1] < other[3] && other[1] < one[3];
const worldRing = (ring) => ring.map(([lon, lat]) => [mercatorX(lon), mercatorY(bounded(lat, -89, 89))]);

// On the turn of the world that is nearest to the middle of the map.
function pixelOf(frame, [lon, lat]) {
  const middle = frame.left + frame.width / frame.size / 2;
  const x = mercatorX(lon);
  return [(x + Math.round(middle - x) - frame.left) * frame.size, (mercatorY(bounded(lat, -89, 89)) - frame.top) * frame.size];
}

// Begins a path of rings on each turn of the world that is in view.
function trace(context, frame, rings) {
  context.beginPath();
  const right = frame.left + frame.width / frame.size;
  for (const ring of rings) {
    const xs = ring.map(([x]) => x);
    const [west, east] = [xs.reduce((a, b) => Math.min(a, b)), xs.reduce((a, b) => Math.max(a, b))];
    for (let turn = Math.ceil(frame.left - east); west + turn < right; turn += 1) {
      ring.forEach(([x, y], i) => {
        context[i === 0 ? "moveTo" : "lineTo"]((x + turn - frame.left) * frame.size, (y - frame.top) * frame.size);
      });
      context.closePath();
    }
  }
}

function write(context, text, [x, y], ink) {
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.strokeStyle = colour("sea");
  context.lineWidth = 3;
  context.strokeText(text, x, y);
  context.fillStyle = colour(ink);
  context.fillText(text, x, y);
}
