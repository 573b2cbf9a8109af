// What moves: havens at the time that is shown, drawn on a canvas above the map, and the names of what is there.

import { labelOf, moment } from "./format.js";
import { writeNames } from "./labels.js";
import { stateText } from "./live.js";
import { isThere, nextStart } from "./model.js";
import { Motion } from "./motion.js";
import { colour } from "./theme.js";
import { mercatorX, mercatorY, shortest } from "./world.js";

const DOT_PX = 3; // a haven that is smaller is a dot
const SHIP_PX = 5; // of half a mark of a last position
const MOST_NAMES = 80; // more would cover the map
const NEAR_PX = 8; // how near a click must be
const MOST_PARTS = 128; // of which a leg is drawn
const DIMMED = 0.15; // of what is drawn beside a chosen pair
const NAMES_DIMMED = 0.4;
// Of the first and second object of the pair that is chosen, of what is in conflict while none is, and of all else.
const TONES = { plain: "haven", inConflict: "conflict", a: "a", b: "b" };
const INKS = { plain: "ink-soft", inConflict: "conflict-ink", a: "a-ink", b: "b-ink", inactive: "ink-faint" };
const RANKS = { a: 0, b: 0, inConflict: 1, plain: 2, inactive: 3 };

function kindOf(key, { pair, inConflict }) {
  if (pair.length) return key === pair[0] ? "a" : key === pair[1] ? "b" : "plain";
  return inConflict.has(key) ? "inConflict" : "plain";
}

export class Havens {
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    // In memory, as the overview: ten thousand dots are drawn in some milliseconds whatever the graphics card.
    this.context = canvas.getContext("2d", { willReadFrequently: true });
    this.tracks = [];
    this.areas = [];
    this.shown = []; // of each track that was drawn: x, y, reach in pixels
    this.names = []; // that were written, { text, box }
    this.namePlaces = new Map(); // where, by key (labels.js)
    this.below = () => []; // boxes of names on the map
    this.t = 0;
    this.plan = null; // of a track that departs later, { key, laterUs }
    this.focus = null; // of the pair that is chosen (focus.js)
    this.isStill = false; // while it is printed
    this.live = new Map(); // how tracks keep their plans, by key (live.js)
    this.planned = new WeakMap(); // { t, place } of a track (plannedPlace)
    this.marks = { hidden: new Set(), inConflict: new Set(), pair: [], isChosen: false };
    view.map.on("render", () => this.draw());
  }

  // Paths in units of the world, once; between waypoints they are straight but for what `bend` says, in those units.
  take(tracks, areas) {
    this.areas = areas;
    this.tracks = tracks.map(withLine);
  }

  // A track one of whose waypoints is elsewhere.
  bentTrack(track, [n, lon, lat]) {
    const { points, outline, grow, outlines, scene, departures } = track.motion;
    const moved = points.map((point, i) => (i === n ? { ...point, lon, lat } : point));
    return withLine({ ...track, motion: new Motion(moved, outline, grow, outlines, scene, departures) });
  }

  // Paths as lines on the map, x and y in turn (units of the world, without jumps), within a share of a unit of the truth.
  lines(unit) {
    return this.tracks.map((track) => ({ object: track, line: lineOf(track, unit) }));
  }

  // Where the reference points of tracks that are under way are, in units of the world, within a share of a pixel of the truth:
  // [track, place] each.
  places(tracks, t, pixel) {
    const found = [];
    const bent = [];
    for (const track of tracks) {
      const { motion, x, y, bend } = track;
      const i = motion.legAt(t);
      if (i < 0) continue;
      const [from, to] = [motion.points[i].t, motion.points[i + 1].t];
      const share = (motion.own(t) - from) / (to - from);
      const place = [x[i] + share * (x[i + 1] - x[i]), y[i] + share * (y[i + 1] - y[i])];
      if (bend[i] > 0.3 * pixel) bent.push([motion, place]);
      found.push([track, place]);
    }
    const exact = bent.length ? bent[0][0].ground.places(bent.map(([motion]) => [motion, t])) : [];
    exact.forEach((known, n) => { if (known) [bent[n][1][0], bent[n][1][1]] = [mercatorX(known[0]), mercatorY(known[1])]; });
    return found;
  }

  // Where a track was planned at its last position; null: nowhere. Found once for each position and plan.
  plannedPlace(track, t) {
    const known = this.planned.get(track);
    if (known?.t === t) return known.place;
    const place = this.places([track], t, 0)[0]?.[1] ?? null;
    this.planned.set(track, { t, place });
    return place;
  }

  resize(width, height) {
    const ratio = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, width, height);
  }

  draw() {
    if (this.isStill) return;
    const frame = this.view.frame();
    const { context, marks } = this;
    this.resize(frame.width, frame.height);
    this.shown = [];
    const kinds = { plain: [], inConflict: [], a: [], b: [] };
    const reach = { w: frame.width / frame.size, h: frame.height / frame.size };
    const seen = this.tracks.filter(({ key }) => !marks.hidden.has(key));
    for (const [track, place] of this.places(seen, this.t, 1 / frame.size)) {
      // The reach of the haven: metres there are this much longer on the map.
      const reachPx = track.motion.reachM * Math.cosh(2 * Math.PI * (0.5 - place[1])) / frame.metresPerPixel;
      const margin = Math.min(1, (reachPx + 2) / frame.size); // next to a pole it would be endless
      if (place[1] < frame.top - margin || place[1] > frame.top + reach.h + margin) continue;
      // On each turn of the world that is in view.
      let x = place[0] - Math.floor(place[0] - (frame.left - margin));
      for (; x < frame.left + reach.w + margin; x += 1) {
        const kind = kindOf(track.key, marks);
        const one = { track, x: (x - frame.left) * frame.size, y: (place[1] - frame.top) * frame.size, reachPx, turn: x - place[0] };
        kinds[kind].push(one);
        this.shown.push(one);
      }
    }
    for (const [kind, some] of Object.entries(kinds)) {
      if (!some.length) continue;
      context.fillStyle = context.strokeStyle = colour(TONES[kind]);
      this.drawAll(some, frame, kind);
    }
    if (this.plan) this.drawPlan(frame);
    this.drawShips(frame);
    this.drawNames(frame, this.focus?.draw(context, frame, this.t) ?? []);
  }

  // Last positions, each with a line to where its track was planned then.
  drawShips(frame) {
    if (this.live.size === 0) return;
    const { context } = this;
    const middle = frame.left + frame.width / frame.size / 2;
    const across = ([x, y]) => [(x + Math.round(middle - x) - frame.left) * frame.size, (y - frame.top) * frame.size];
    for (const track of this.tracks) {
      const ship = this.live.get(track.key);
      if (!ship || this.marks.hidden.has(track.key)) continue;
      const [x, y] = across([mercatorX(ship.lon), mercatorY(ship.lat)]);
      if (!(x > -SHIP_PX && y > -SHIP_PX && x < frame.width + SHIP_PX && y < frame.height + SHIP_PX)) continue;
      context.strokeStyle = context.fillStyle = colour(ship.state === "on plan" ? "haven" : "conflict-ink");
      context.lineWidth = 1.5;
      const planned = this.plannedPlace(track, ship.t);
      if (planned) {
        const [px, py] = across(planned);
        context.setLineDash([2, 3]);
        context.beginPath();
        context.moveTo(x, y);
        context.lineTo(px, py);
        context.stroke();
        context.setLineDash([]);
      }
      context.beginPath();
      context.moveTo(x, y - SHIP_PX);
      context.lineTo(x + SHIP_PX, y);
      context.lineTo(x, y + SHIP_PX);
      context.lineTo(x - SHIP_PX, y);
      context.closePath();
      if (ship.state !== "silent") context.fill();
      context.stroke();
    }
  }

  // The path of a moved plan and its haven, dashed.
  drawPlan(frame) {
    const { context } = this;
    if (this.plan.rings) {
      this.drawRings(frame, this.plan.rings);
      return;
    }
    const known = this.tracks.find(({ key }) => key === this.plan.key);
    if (!known) return;
    const track = this.plan.waypoint ? this.bentTrack(known, this.plan.waypoint) : known;
    const middle = frame.left + frame.width / frame.size / 2;
    context.strokeStyle = context.fillStyle = colour(this.marks.pair[1] === this.plan.key ? "b" : "a");
    context.lineWidth = 2;
    context.setLineDash([6, 4]);
    const draw = (line, isClosed) => {
      const turn = Math.round(middle - line[0]);
      context.beginPath();
      for (let i = 0; i < line.length; i += 2) {
        context.lineTo((line[i] + turn - frame.left) * frame.size, (line[i + 1] - frame.top) * frame.size);
      }
      if (isClosed) context.closePath();
      context.stroke();
    };
    draw(lineOf(track, 1 / frame.size), false);
    const ring = track.motion.haven(this.t - this.plan.laterUs / 1e6);
    if (ring) {
      draw(ring.flatMap(([lon, lat]) => [mercatorX(lon), mercatorY(lat)]), true);
      context.globalAlpha = 0.15;
      context.fill();
      context.globalAlpha = 1;
    }
    context.setLineDash([]);
  }

  // The outline of an area that is moved, dashed.
  drawRings(frame, rings) {
    const { context } = this;
    const middle = frame.left + frame.width / frame.size / 2;
    context.strokeStyle = context.fillStyle = colour("a");
    context.lineWidth = 2;
    context.setLineDash([6, 4]);
    context.beginPath();
    for (const ring of rings) {
      const turn = Math.round(middle - mercatorX(ring[0][0]));
      ring.forEach(([lon, lat], i) => {
        const [x, y] = [(mercatorX(lon) + turn - frame.left) * frame.size, (mercatorY(Math.max(-89, Math.min(89, lat))) - frame.top) * frame.size];
        if (i === 0) context.moveTo(x, y);
        else context.lineTo(x, y);
      });
      context.closePath();
    }
    context.stroke();
    context.globalAlpha = 0.15;
    context.fill("evenodd");
    context.globalAlpha = 1;
    context.setLineDash([]);
  }

  drawAll(some, frame, kind) {
    const { context } = this;
    const isPair = kind === "a" || kind === "b";
    const strength = this.marks.isChosen && !isPair ? DIMMED : 1; // beside a pair that is chosen
    context.lineWidth = isPair ? 2.5 : 1.5;
    context.setLineDash(kind === "b" ? [6, 3] : []);
    context.beginPath();
    const large = some.filter(({ reachPx }) => reachPx >= DOT_PX);
    const rings = large.length ? large[0].track.motion.ground.havens(large.map(({ track }) => [track.motion, this.t])) : [];
    for (const [n, one] of large.entries()) {
      rings[n]?.forEach(([lon, lat], i) => {
        const x = (mercatorX(lon) + one.turn + turnsBetween(one, lon, frame) - frame.left) * frame.size;
        const y = (mercatorY(lat) - frame.top) * frame.size;
        if (i === 0) context.moveTo(x, y);
        else context.lineTo(x, y);
      });
      context.closePath();
    }
    // Of a pair, the region below is to be seen.
    context.globalAlpha = (isPair ? 0.12 : kind === "plain" ? 0.25 : 0.3) * strength;
    context.fill();
    context.globalAlpha = strength;
    context.stroke();
    context.setLineDash([]);
    const size = kind === "plain" ? DOT_PX : DOT_PX + 1;
    for (const { x, y, reachPx } of some) if (reachPx < DOT_PX) context.fillRect(x - size / 2, y - size / 2, size, size);
    context.globalAlpha = 1;
  }

  // Names of havens, and of areas that are there, where there is room: those in conflict first. `taken`: boxes without room.
  drawNames(frame, taken) {
    const { context, marks, t } = this;
    const kind = (object) => (object.kind === "area" && !isThere(object, t) && !marks.pair.includes(object.key) ? "inactive" : kindOf(object.key, marks));
    const rank = (object) => RANKS[kind(object)];
    // Of an area that is not active: from when on it is; of a track with positions: how it keeps its plan.
    const text = (object) => {
      if (object.kind === "area") return isThere(object, t) ? labelOf(object) : `${labelOf(object)}, ${whenActive(object, t)}`;
      const ship = this.live.get(object.key);
      return ship && ship.state !== "on plan" ? `${labelOf(object)}, ${stateText(ship)}` : labelOf(object);
    };
    const named = this.shown.map(({ track, x, y, reachPx }) => ({ object: track, x, y, reach: Math.min(reachPx, 60) }));
    for (const area of this.areas) {
      if (marks.hidden.has(area.key)) continue;
      const [west, , east] = area.box;
      const [lon, lat] = area.inside;
      const place = mercatorX(lon);
      const y = (mercatorY(Math.max(-85, Math.min(85, lat))) - frame.top) * frame.size;
      for (let x = place - Math.floor(place - frame.left); x < frame.left + frame.width / frame.size; x += 1) {
        const widthPx = ((east - west) / 360) * frame.size;
        if (widthPx > 24) named.push({ object: area, x: (x - frame.left) * frame.size, y, reach: -9 });
      }
    }
    const isWritten = this.focus ? ({ key }) => marks.pair.includes(key) : () => false;
    const near = named.filter(({ object, x, y }) => !isWritten(object) && x > 0 && y > 8 && x < frame.width && y < frame.height - 8);
    const some = near.filter(({ object }) => near.length <= MOST_NAMES || rank(object) < 2).slice(0, MOST_NAMES);
    some.sort((a, b) => rank(a.object) - rank(b.object));
    context.globalAlpha = this.focus ? NAMES_DIMMED : 1;
    this.names = writeNames(context, some.map(({ object, x, y, reach }) => ({ key: object.key, text: text(object), ink: INKS[kind(object)], x, y, reach })), [...taken, ...this.below()], frame, this.namePlaces);
    context.globalAlpha = 1;
  }

  // The object whose haven is at a pixel, or next to it.
  at({ x, y }) {
    const found = this.shown
      .map((one) => ({ one, d: Math.hypot(one.x - x, one.y - y) }))
      .filter(({ one, d }) => d < Math.max(one.reachPx, NEAR_PX))
      .sort((a, b) => a.d - b.d);
    return found[0]?.one.track ?? null;
  }
}

// When an area is active that is not now.
function whenActive(area, t) {
  const next = nextStart(area, t);
  return next === null ? "no longer active" : `from ${moment(next, t).replace(/(:\d\d):00$/, "$1")}`;
}

// A track with its path in units of the world.
function withLine(track) {
  const { points } = track.motion;
  const [x, y] = [new Float64Array(points.length), new Float64Array(points.length)];
  const bend = new Float64Array(points.length);
  points.forEach(({ lon, lat }, i) => {
    x[i] = mercatorX(lon);
    if (i > 0) x[i] = x[i - 1] + shortest(x[i] - x[i - 1]);
    y[i] = mercatorY(lat);
    if (i > 0) bend[i - 1] = bent(points[i - 1], points[i], track.motion.scene.motion);
  });
  return { ...track, x, y, bend };
}

// Longitudes of a ring run on from those of its reference point, which may be a turn away from what `place` gives.
function turnsBetween(one, lon, frame) {
  const middle = frame.left + one.x / frame.size - one.turn;
  return -Math.round(mercatorX(lon) - middle);
}

function lineOf({ motion, x, y, bend }, unit) {
  const line = [x[0], y[0]];
  for (let i = 0; i + 1 < x.length; i += 1) {
    const parts = Math.min(MOST_PARTS, Math.ceil(Math.sqrt(bend[i] / unit)));
    for (const [lon, lat] of parts > 1 ? motion.along(i, parts) : []) {
      line.push(x[i] + shortest(mercatorX(lon) - x[i] + Math.floor(x[i])), mercatorY(lat));
    }
    line.push(x[i + 1], y[i + 1]);
  }
  return line;
}

// By how much a leg may leave the straight line, in time or space, on the map: units of the world.
function bent(from, to, motion) {
  const lat = (Math.max(Math.abs(from.lat), Math.abs(to.lat)) * Math.PI) / 180;
  const way = Math.hypot(to.lat - from.lat, (motion === "great_circle" ? 1 : 0) * (to.lon - from.lon)) * Math.PI / 180;
  return (way * way * (1 / Math.cos(lat) ** 2)) / 8 / (2 * Math.PI) + (Math.abs(lat) > 1.5 ? 1 : 0);
}
