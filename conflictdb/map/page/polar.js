// The map about a pole, where Web Mercator ends: polar stereographic, so that shapes are true. All of it is drawn here.

import { barLength, distance, labelOf } from "./format.js";
import { colour, font, theme } from "./theme.js";
import { RADIANS, SPHERE_M } from "./world.js";

const LOWEST_LAT = -30; // degrees, seen from the pole: what lies beyond is drawn there, far outside of what is shown
const LEAST_LAT = 20; // objects that stay below are left out
const EDGE_DEG = 1; // sides that are longer, in longitude and latitude, get points
const MOST_PARTS = 128; // of a leg or a side
const SEAM_DEG = 1e-6;
const SCALES = [200, 2e7]; // pixels for the radius of the earth, least and most
const FIT_PX = 60;
const LABEL_PX = 110; // between two lines
const CLICK_PX = 6;
const DRAG_PX = 4;
const MOST_NAMES = 80;
const STEPS = [30, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001];

// Where a place is seen from above a pole (1: north, -1: south): x and y (down) in radii of the earth, 0 at the pole.
export function seenFrom(pole, [lon, lat]) {
  const r = 2 * Math.tan(((90 - Math.max(LOWEST_LAT, pole * lat)) * RADIANS) / 2);
  return [r * Math.sin(lon * RADIANS), pole * r * Math.cos(lon * RADIANS)];
}

// The place that is seen there: longitude and latitude, degrees.
export function placeAt(pole, [x, y]) {
  return [Math.atan2(x, pole * y) / RADIANS, pole * (90 - (2 * Math.atan(Math.hypot(x, y) / 2)) / RADIANS)];
}

const strength = ({ hidden, chosen, dim, on }, ofChosen, ofOn, ofOff, ofDim) => (
  hidden ? 0 : chosen ? ofChosen : dim ? ofDim : on ? ofOn : ofOff);
const hueOf = ({ a, b }, plain) => (a ? "a" : b ? "b" : plain);

export class PolarView {
  // `flags` gives what says how an object or a conflict is shown, as for the map.
  constructor(canvas, source, flags) {
    this.canvas = canvas;
    this.source = source;
    this.flags = flags;
    this.context = canvas.getContext("2d", { willReadFrequently: true }); // in memory, as the overview
    this.isShown = false;
    this.isStill = false; // while it is printed
    this.pole = 1;
    this.centre = [0, 0]; // radii of the earth
    this.scale = 400; // pixels for one
    this.t = 0;
    this.collections = null; // GeoJSON of each layer
    this.paths = null; // what is drawn of it
    this.land = null;
    this.names = [];
    this.inConflict = new Set();
    new ResizeObserver(() => this.draw()).observe(canvas);
    theme.onChange(() => this.draw());
    this.listen();
  }

  listen() {
    const { canvas } = this;
    let held = null;
    canvas.addEventListener("pointerdown", (event) => {
      held = { x: event.offsetX, y: event.offsetY, far: 0 };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", ({ offsetX: x, offsetY: y }) => {
      if (!held) return;
      this.centre = [this.centre[0] - (x - held.x) / this.scale, this.centre[1] - (y - held.y) / this.scale];
      held = { x, y, far: held.far + Math.hypot(x - held.x, y - held.y) };
      this.draw();
    });
    canvas.addEventListener("pointerup", ({ offsetX: x, offsetY: y }) => {
      if (held && held.far < DRAG_PX) this.onClick?.({ x, y });
      held = null;
    });
    canvas.addEventListener("pointercancel", () => { held = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.002), [event.offsetX, event.offsetY]);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-80, 0], ArrowRight: [80, 0], ArrowUp: [0, -80], ArrowDown: [0, 80] }[event.key];
      const factor = { "+": 2, "=": 2, "-": 0.5 }[event.key];
      if (!by && !factor) return;
      event.preventDefault();
      event.stopPropagation();
      if (factor) this.zoom(factor);
      else this.centre = this.centre.map((x, i) => x + by[i] / this.scale);
      this.draw();
    });
  }

  // Shows so many times more; what is at a pixel, in the middle unless one is given, stays there.
  zoom(factor, at = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    const still = this.unproject(at);
    this.scale = Math.min(SCALES[1], Math.max(SCALES[0], this.scale * factor));
    const [x, y] = [at[0] - this.canvas.clientWidth / 2, at[1] - this.canvas.clientHeight / 2];
    this.centre = [still[0] - x / this.scale, still[1] - y / this.scale];
    this.draw();
  }

  unproject([x, y]) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [this.centre[0] + (x - width / 2) / this.scale, this.centre[1] + (y - height / 2) / this.scale];
  }

  // The pixel of a place.
  project(place) {
    const [x, y] = seenFrom(this.pole, place);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [width / 2 + (x - this.centre[0]) * this.scale, height / 2 + (y - this.centre[1]) * this.scale];
  }

  // Shows some places, those nearer to one pole than to the other.
  goTo(places) {
    const north = places.reduce((sum, [, lat]) => sum + lat, 0) >= 0 ? 1 : -1;
    if (north !== this.pole) [this.pole, this.paths] = [north, null];
    const seen = places.map((place) => seenFrom(this.pole, place));
    const [xs, ys] = [seen.map(([x]) => x), seen.map(([, y]) => y)];
    const [west, east, top, low] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const room = (length) => Math.max(50, length - 2 * FIT_PX);
    this.centre = [(west + east) / 2, (top + low) / 2];
    const fits = Math.min(room(this.canvas.clientWidth) / (east - west), room(this.canvas.clientHeight) / (low - top));
    this.scale = Math.min(2e5, Math.max(SCALES[0], fits));
    this.draw();
  }

  // Reads shapes anew; of land once.
  async take(model) {
    this.model = model;
    const [shapes, land] = await Promise.all([this.source.shapes(), this.land ?? this.source.landShapes()]);
    if (this.model !== model) return; // it was read again meanwhile
    [this.land, this.collections, this.paths] = [land, shapes, null];
    this.draw();
  }

  // Paths of all shapes as they are seen from the pole, once.
  build() {
    const { pole, model, collections, land } = this;
    const isStraight = model.scene.motion === "great_circle";
    const known = (kind) => new Map(model[kind].map((one) => [one.id, one]));
    const [areas, conflicts] = [known("areas"), known("conflicts")];
    const shapesOf = (features, objects, straight) => features.map(({ id, geometry }) => ({ one: objects.get(id), ...pathsOf(geometry, pole, straight) }))
      .filter(({ one, isSeen }) => one && isSeen);
    this.paths = {
      land: land.map(({ properties, geometry }) => ({ kind: properties.kind, ...pathsOf(geometry, pole, false) })).filter(({ isSeen }) => isSeen),
      areas: shapesOf(collections.areas.features, areas, isStraight),
      conflicts: shapesOf(collections.conflicts.features, conflicts, false),
      tracks: model.tracks.map((one) => ({ one, edge: trackPath(one.motion, pole) })).filter(({ edge }) => edge),
    };
  }

  draw() {
    if (!this.isShown || this.isStill || !this.collections) return;
    if (!this.paths) this.build();
    const { canvas, context, centre, scale, paths } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const plain = () => context.setTransform(ratio, 0, 0, ratio, 0, 0);
    plain();
    context.fillStyle = colour("sea");
    context.fillRect(0, 0, width, height);
    context.setTransform(ratio * scale, 0, 0, ratio * scale, ratio * (width / 2 - centre[0] * scale), ratio * (height / 2 - centre[1] * scale));
    const tones = Object.fromEntries(["object", "conflict", "a", "b", "land", "coast", "haven"].map((name) => [name, colour(name)]));
    const fill = (path, tone, alpha) => {
      [context.fillStyle, context.globalAlpha] = [tones[tone], alpha];
      context.fill(path, "evenodd");
    };
    const stroke = (path, tone, alpha, widthPx, dash = []) => {
      [context.strokeStyle, context.globalAlpha, context.lineWidth] = [tones[tone], alpha, widthPx / scale];
      context.setLineDash(dash.map((px) => px / scale));
      context.stroke(path);
      context.setLineDash([]);
    };
    for (const { kind, fill: path, edge } of paths.land) {
      if (kind === "land") fill(path, "land", 1);
      else stroke(edge, "coast", 1, 0.8);
    }
    const flagsOf = this.flags();
    for (const { one, fill: path, edge } of paths.areas) {
      const is = flagsOf(one);
      if (is.hidden) continue;
      fill(path, hueOf(is, "object"), strength(is, 0.2, 0.14, 0.03, 0.02));
      stroke(edge, hueOf(is, "object"), strength(is, 1, 0.75, 0.25, 0.15), is.chosen ? 2.5 : 1);
    }
    for (const { one, edge } of paths.tracks) {
      const is = flagsOf(one);
      if (!is.hidden) stroke(edge, hueOf(is, "object"), strength(is, 1, 0.4, 0.12, 0.08), is.chosen ? 2.5 : 1);
    }
    for (const { one, fill: path, edge } of paths.conflicts) {
      const is = flagsOf(one);
      if (is.hidden) continue;
      // Of objects that changed since, without a fill and dashed.
      if (one.is_current) fill(path, "conflict", strength(is, 0.6, 0.45, 0.1, 0.03));
      stroke(edge, "conflict", strength(is, 1, 0.95, 0.35, 0.12), is.chosen ? 2.5 : 1.2, one.is_current ? [] : [6, 4]);
    }
    plain();
    context.globalAlpha = 1;
    this.drawLines(width, height);
    this.drawHavens(flagsOf, tones);
    this.drawContacts(flagsOf, tones);
    this.drawNames(width, height);
    this.drawScale(height);
  }

  drawContacts(flagsOf, tones) {
    const { context } = this;
    for (const one of this.model.conflicts) {
      if (one.lon === null || this.pole * one.lat < LEAST_LAT) continue;
      const is = flagsOf(one);
      if (is.hidden) continue;
      const [x, y] = this.project([one.lon, one.lat]);
      context.globalAlpha = strength(is, 1, 0.9, 0.4, 0.15);
      context.beginPath();
      context.arc(x, y, is.chosen ? 5 : 2.5, 0, 2 * Math.PI);
      [context.fillStyle, context.strokeStyle] = one.is_current ? [tones.conflict, colour("paper")] : [colour("paper"), tones.conflict];
      context.lineWidth = 1;
      context.fill();
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  drawHavens(flagsOf, tones) {
    const { context, t } = this;
    this.names = [];
    const shown = this.model.tracks.filter((track) => !flagsOf(track).hidden);
    const ask = shown.map(({ motion }) => [motion, t]);
    const { ground } = this.model.scene;
    const [places, rings] = [ground.places(ask), ground.havens(ask)];
    for (const [n, track] of shown.entries()) {
      const is = flagsOf(track);
      const place = places[n];
      if (place === null || this.pole * place[1] < LEAST_LAT) continue;
      const tone = is.chosen ? hueOf(is) : this.inConflict.has(track.key) && !is.dim ? "conflict" : "haven";
      [context.fillStyle, context.strokeStyle] = [tones[tone], tones[tone]];
      context.lineWidth = is.chosen ? 2.5 : 1.5;
      context.setLineDash(is.b ? [6, 3] : []);
      context.beginPath();
      const ring = (rings[n] ?? [place]).map((corner) => this.project(corner));
      ring.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      context.globalAlpha = is.dim ? 0.1 : is.chosen ? 0.12 : 0.3;
      context.fill();
      context.globalAlpha = is.dim ? 0.35 : 1;
      context.stroke();
      context.setLineDash([]);
      const [x, y] = this.project(place);
      const reach = Math.max(...ring.map((corner) => Math.hypot(corner[0] - x, corner[1] - y)));
      if (reach < 3) context.fillRect(x - 1.5, y - 1.5, 3, 3);
      this.names.push({ object: track, x, y: y - Math.min(reach, 60) - 9, at: [x, y], reach, rank: is.chosen ? 0 : tone === "conflict" ? 1 : 2, is });
    }
    context.globalAlpha = 1;
    for (const { one } of this.paths.areas) {
      const is = flagsOf(one);
      if (is.hidden || !is.on) continue;
      const [x, y] = this.project(one.inside);
      this.names.push({ object: one, x, y, rank: is.chosen ? 0 : this.inConflict.has(one.key) && !is.dim ? 1 : 2, is });
    }
  }

  drawNames(width, height) {
    const { context } = this;
    const inks = [null, "conflict-ink", "ink-soft"];
    const near = this.names.filter(({ x, y }) => x > 0 && y > 8 && x < width && y < height - 8);
    const taken = [];
    for (const { object, x, y, rank, is } of near.sort((a, b) => a.rank - b.rank).slice(0, MOST_NAMES)) {
      const text = labelOf(object);
      this.prepareText("center");
      const half = context.measureText(text).width / 2 + 3;
      if (taken.some((o) => x - half < o[2] && o[0] < x + half && y - 8 < o[3] && o[1] < y + 8)) continue;
      taken.push([x - half, y - 8, x + half, y + 8]);
      this.write(text, x, y, inks[rank] ?? (is.a ? "a-ink" : "b-ink"));
    }
  }

  prepareText(align) {
    Object.assign(this.context, { font: font("small"), textAlign: align, textBaseline: "middle", lineJoin: "round" });
  }

  write(text, x, y, ink) {
    const { context } = this;
    [context.strokeStyle, context.lineWidth, context.fillStyle] = [colour("sea"), 3, colour(ink)];
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  }

  // Parallels and meridians. Parallels have their names on the meridian of the middle, meridians where they cross a parallel.
  drawLines(width, height) {
    const { context, pole, scale, centre } = this;
    const [lon, lat] = placeAt(pole, centre);
    const away = Math.hypot(...centre);
    const reach = Math.hypot(width, height) / 2 / scale;
    const step = STEPS.findLast((one) => one * RADIANS * scale >= LABEL_PX) ?? STEPS[0];
    const least = pole * placeAt(pole, [0, away + reach])[1];
    const most = away < reach ? 90 : pole * placeAt(pole, [0, away - reach])[1];
    const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    const [x0, y0] = this.project([0, pole * 90]);
    context.strokeStyle = colour("line-map");
    context.lineWidth = 1;
    const labels = [];
    for (let n = Math.ceil(Math.max(least, 0) / step); n * step <= most && n * step < 90; n += 1) {
      const r = Math.hypot(...seenFrom(pole, [0, pole * n * step])) * scale;
      context.beginPath();
      context.arc(x0, y0, r, 0, 2 * Math.PI);
      context.stroke();
      labels.push([`${(n * step).toFixed(digits)}° ${pole > 0 ? "N" : "S"}`, ...this.project([away < reach / 4 ? 15 : lon, pole * n * step])]);
    }
    const turn = STEPS.findLast((one) => one * RADIANS * Math.max(away, reach / 2) * scale >= LABEL_PX) ?? STEPS[0];
    const named = away < reach ? pole * placeAt(pole, [0, (Math.min(width, height) * 0.4) / scale])[1] : pole * lat;
    for (let n = Math.round(-180 / turn) + 1; n * turn <= 180 && 360 / turn <= 720; n += 1) {
      const [x, y] = this.project([n * turn, pole * Math.max(least, -20)]);
      context.beginPath();
      context.moveTo(...this.project([n * turn, pole * (90 - Math.min(step, 10) / 10)]));
      context.lineTo(x, y);
      context.stroke();
      const size = Math.abs(n * turn).toFixed(Math.max(0, Math.ceil(-Math.log10(turn) - 1e-9)));
      labels.push([[0, 180].includes(Number(size)) ? `${Number(size)}°` : `${size}° ${n < 0 ? "W" : "E"}`, ...this.project([n * turn, pole * named])]);
    }
    this.prepareText("center");
    for (const [text, x, y] of labels) if (x > 20 && y > 10 && x < width - 20 && y < height - 40) this.write(text, x, y, "ink-soft");
  }

  // A bar that is true in the middle of the view.
  drawScale(height) {
    const { context } = this;
    const metre = this.metresPerPixel();
    const length = barLength(140 * metre);
    context.strokeStyle = colour("ink-soft");
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(11, height - 28);
    context.lineTo(11, height - 12);
    context.lineTo(11 + length / metre, height - 12);
    context.lineTo(11 + length / metre, height - 28);
    context.stroke();
    this.prepareText("left");
    this.write(distance(length).replace(".0 ", " "), 16, height - 22, "ink-soft");
  }

  metresPerPixel() {
    return SPHERE_M / (this.scale * (1 + Math.hypot(...this.centre) ** 2 / 4));
  }

  // The conflicts at a pixel: first contacts before regions.
  conflictsAt({ x, y }) {
    const flagsOf = this.flags();
    const seen = this.model.conflicts.filter((one) => !flagsOf(one).hidden);
    const contacts = seen.filter(({ lon, lat }) => {
      if (lon === null) return false;
      const [u, v] = this.project([lon, lat]);
      return Math.hypot(u - x, v - y) <= CLICK_PX;
    });
    const [u, v] = this.unproject([x, y]);
    this.context.save();
    this.context.resetTransform();
    const regions = this.paths.conflicts.filter(({ one, fill }) => seen.includes(one) && this.context.isPointInPath(fill, u, v, "evenodd"));
    this.context.restore();
    return [...contacts.map(({ id }) => id), ...regions.map(({ one }) => one.id)];
  }

  // The track whose haven is at a pixel.
  at({ x, y }) {
    return this.names.filter(({ at, reach }) => at && Math.hypot(at[0] - x, at[1] - y) <= Math.max(reach, CLICK_PX))
      .sort((a, b) => a.reach - b.reach)[0]?.object ?? null;
  }
}

// Paths of polygons or lines (GeoJSON): one to fill, and the edges without cuts along the seam and the pole. Sides are straight
// in longitude and latitude, or else, `isStraight`, great circles with points close enough to be straight here.
function pathsOf({ type, coordinates }, pole, isStraight) {
  const lines = type === "MultiPolygon" ? coordinates.flat() : type === "Polygon" || type === "MultiLineString" ? coordinates : [coordinates];
  const [fill, edge] = [new Path2D(), new Path2D()];
  let isSeen = false;
  for (const line of lines) {
    if (!line.some(([, lat]) => pole * lat > LEAST_LAT)) continue;
    isSeen = true;
    fill.moveTo(...seenFrom(pole, line[0]));
    edge.moveTo(...seenFrom(pole, line[0]));
    for (let i = 1; i < line.length; i += 1) {
      const [from, to] = [line[i - 1], line[i]];
      const isCut = [from, to].every(([lon]) => Math.abs(lon) > 180 - SEAM_DEG) || [from, to].every(([, lat]) => Math.abs(lat) > 90 - SEAM_DEG);
      const size = Math.max(Math.abs(to[0] - from[0]), Math.abs(to[1] - from[1]));
      const parts = isStraight || isCut ? 1 : Math.min(MOST_PARTS, Math.max(1, Math.ceil(size / EDGE_DEG)));
      for (let n = 1; n <= parts; n += 1) {
        const share = n / parts;
        const place = seenFrom(pole, [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]);
        fill.lineTo(...place);
        if (isCut) edge.moveTo(...place);
        else edge.lineTo(...place);
      }
    }
    if (/Polygon/.test(type)) fill.closePath();
  }
  return { fill, edge, isSeen };
}

// The way of a reference point; null where it stays away from the pole.
function trackPath(motion, pole) {
  const { points } = motion;
  if (!points.some(({ lat }) => pole * lat > LEAST_LAT)) return null;
  const path = new Path2D();
  path.moveTo(...seenFrom(pole, [points[0].lon, points[0].lat]));
  for (let i = 0; i + 1 < points.length; i += 1) {
    const turn = Math.abs(points[i + 1].lon - points[i].lon) % 360;
    const size = Math.max(Math.min(turn, 360 - turn), Math.abs(points[i + 1].lat - points[i].lat));
    const parts = Math.min(MOST_PARTS, Math.max(1, Math.ceil(size / EDGE_DEG)));
    for (const place of motion.along(i, parts)) path.lineTo(...seenFrom(pole, place));
    path.lineTo(...seenFrom(pole, [points[i + 1].lon, points[i + 1].lat]));
  }
  return path;
}
