// The page: what is shown, and what happens when something is chosen, moved or changed.

import { byId } from "./dom.js";
import { Detail } from "./detail.js";
import { EmbeddedSource } from "./embedded.js";
import { clock, counted, day, instantOf, printable } from "./format.js";
import { Graticule } from "./graticule.js";
import { Havens } from "./havens.js";
import { List } from "./list.js";
import { MapView } from "./map.js";
import { Filter, MERCATOR_END, meet, Model } from "./model.js";
import { PolarView } from "./polar.js";
import { ServerSource } from "./source.js";
import { theme } from "./theme.js";
import { Timeline } from "./timeline.js";

const SPEEDS = [1, 10, 60, 300, 900, 3600, 21600, 86400, 604800]; // seconds in a second
const PLAYED_S = 40; // how long all of a scene takes at the speed that is set at first
const MARKS_MS = 120; // how often the map hears what is on, while the time moves
const MARKS_SHARE = 0.2; // of the time, at most, that this takes
const POLAR_LAT = 75; // degrees: what is chosen beyond is shown about the pole
const POLE_LAT = 60; // scenes that reach beyond can be
const LARGE = 2000; // a scene of more objects or conflicts has an overview

const source = byId("scene-data") ? new EmbeddedSource() : new ServerSource();
const filter = new Filter();
let model;
let view;
let havens;
let polar;
let version = 0;
let t = 0;
let chosen = null; // a conflict
let left = []; // the conflicts that the filter leaves
let playing = null;

const list = new List(byId("list"), choose);
const buttons = { closer: byId("closer"), wider: byId("wider"), whole: byId("whole") };
const timeline = new Timeline({ canvas: byId("bars"), slider: byId("slider"), buttons }, (at) => { pause(); moveTo(at); }, choose);
const detail = new Detail(byId("detail"), { back: unchoose, goTo: moveTo, acknowledge });

// --- reading ---------------------------------------------------------------------------------------------------------

async function readAll() {
  const scene = await source.scene();
  const [conflicts, areas, tracks, outlines] = await Promise.all([
    source.conflicts(), source.areas(), source.tracks(), hasOverview(scene) ? source.overview() : null,
  ]);
  model = new Model(scene);
  model.takeObjects(areas, tracks, outlines);
  model.takeConflicts(conflicts);
  version = scene.version;
}

const hasOverview = ({ objects }) => (view ? view.overview !== null : source.isLive && objects > LARGE);

async function readConflicts() {
  const scene = await source.scene();
  model.scene = scene;
  model.takeConflicts(await source.conflicts());
  version = scene.version;
}

function tell(text, isLost = false) {
  const state = byId("state");
  state.classList.toggle("lost", isLost);
  state.textContent = printable(text);
}

function describe() {
  const { scene } = model;
  document.title = `${printable(scene.scene)} · conflictdb`;
  byId("title").textContent = printable(scene.scene);
  tell([counted(model.areas.length, "area"), counted(model.tracks.length, "track"),
    scene.is_current ? null : scene.remark,
    scene.copied ? `as of ${scene.copied}, changes since are not in this file` : null].filter(Boolean).join(" · "));
  byId("beyond").hidden = model.beyond === 0;
  byId("beyond").textContent = `${counted(model.beyond, "object")} ${model.beyond === 1 ? "reaches" : "reach"} beyond `
    + `${MERCATOR_END.toFixed(2)}° of latitude, where Web Mercator ends: the polar view shows what lies there.`;
  byId("pole").hidden = !polar.isShown && !reachesPole();
  const stale = model.conflicts.filter((c) => !c.is_current).length;
  byId("stale").hidden = stale === 0;
  byId("stale").textContent = `${counted(stale, "conflict")} (hatched) ${stale === 1 ? "is" : "are"} of objects that changed since: `
    + "detect again to know what holds now.";
  byId("open-choice").hidden = !scene.may_acknowledge && !model.conflicts.some((c) => c.acknowledged_by !== null);
}

// --- showing ---------------------------------------------------------------------------------------------------------

// What the filter leaves: in the list, on the timeline and on the map.
function applyFilter() {
  left = model.conflicts.filter((conflict) => filter.leaves(conflict, model, t));
  list.take(left, whyEmpty());
  timeline.take(left, model.span);
  const isKnown = model.conflicts.length > 0 || model.scene.is_current;
  byId("count").textContent = !isKnown ? "" : filter.isNothing() ? counted(left.length, "conflict")
    : `${left.length.toLocaleString("en")} of ${counted(model.conflicts.length, "conflict")}`;
  const kept = new Set(left.flatMap(({ a, b }) => [a, b]));
  const isHidden = (object) => !filter.leavesObject(object) || (filter.text.trim() !== "" && !filter.names(object) && !kept.has(object.key));
  havens.marks.hidden = new Set([...model.areas, ...model.tracks].filter(isHidden).map(({ key }) => key));
  const ids = new Set(left.map(({ id }) => id));
  hiddenConflicts = new Set(model.conflicts.filter(({ id }) => !ids.has(id)).map(({ id }) => id));
  mark();
}

// Why the list shows nothing, where that is so.
function whyEmpty() {
  const { scene, areas, tracks, conflicts } = model;
  if (model.refused !== null) return `The scene is no longer shown: ${model.refused}.`;
  if (conflicts.length) return "The filter leaves no conflict.";
  if (areas.length + tracks.length === 0) return "The scene has no objects yet. They show here as soon as it has some.";
  return scene.is_current ? "No two objects are in conflict." : `No conflict is known yet (${scene.remark}).`;
}

let hiddenConflicts = new Set();
let marked = 0;
let markTakes = 0; // milliseconds, the last time
let marking = null;

// Tells the map what is on at the time that is shown, what is hidden and what is chosen.
function mark() {
  clearTimeout(marking);
  marking = null;
  marked = performance.now();
  polar.draw();
  const flagsOf = flags();
  if (view.overview) {
    const before = performance.now();
    view.overview.mark(flagsOf);
    markTakes = performance.now() - before;
    if (!view.showsDetail()) return;
  }
  for (const kind of ["areas", "tracks", "conflicts"]) view.show(kind, model[kind].map((one) => [one.id, flagsOf(one)]));
}

// Returns what says of an object or a conflict how it is shown: on, hidden, chosen, of a chosen pair which (a, b), or dimmed
// since another pair is chosen. Conflicts at heights where the chosen one cannot be are hidden.
function flags() {
  const heights = chosen && model.heightsOf(chosen);
  return (one) => {
    if (one.key === undefined) {
      const isChosen = one.id === chosen?.id;
      const isApart = heights !== null && !isChosen && !meet(heights, model.heightsOf(one));
      return {
        on: one.periods.some(([a, b]) => t >= a && t <= b), hidden: isApart || hiddenConflicts.has(one.id),
        chosen: isChosen, dim: chosen !== null && !isChosen,
      };
    }
    const [a, b] = [one.key === chosen?.a, one.key === chosen?.b];
    return {
      on: (one.start ?? -Infinity) <= t && (one.end ?? Infinity) >= t, hidden: havens.marks.hidden.has(one.key),
      chosen: a || b, dim: chosen !== null && !a && !b, a, b,
    };
  };
}

function markSoon() {
  const wait = Math.max(MARKS_MS, markTakes / MARKS_SHARE) - (performance.now() - marked);
  if (wait <= 0) mark();
  else marking ??= setTimeout(mark, wait);
}

function moveTo(at) {
  const [from, to] = model.span;
  t = Math.min(to, Math.max(from, at));
  byId("clock").textContent = clock(t);
  byId("clock").dateTime = new Date(t * 1000).toISOString();
  byId("day").textContent = `UTC, ${day(t)}`;
  timeline.mark(t, chosen?.id ?? null);
  list.show(t, chosen?.id ?? null);
  const on = left.filter((c) => c.periods.some(([a, b]) => t >= a && t <= b));
  havens.t = t;
  havens.marks.inConflict = new Set(on.flatMap(({ a, b }) => [a, b]));
  havens.marks.pair = chosen ? [chosen.a, chosen.b] : [];
  havens.draw();
  polar.t = t;
  polar.inConflict = havens.marks.inConflict;
  polar.draw();
  markSoon();
  if (filter.now) filterSoon();
}

let filtering = null;

function filterSoon() {
  filtering ??= setTimeout(() => { filtering = null; applyFilter(); }, MARKS_MS);
}

// --- choosing --------------------------------------------------------------------------------------------------------

function choose(conflict) {
  pause();
  chosen = conflict;
  byId("all").hidden = true;
  byId("detail").hidden = false;
  detail.show(conflict, model, source.pair(conflict.a, conflict.b), model.scene.may_acknowledge);
  moveTo(Number.isFinite(conflict.start) ? conflict.start : t);
  const box = model.around(conflict, t);
  const lat = (box[1] + box[3]) / 2;
  if (Math.abs(lat) > POLAR_LAT || (polar.isShown && Math.abs(lat) > POLE_LAT)) {
    showPole(true, corners(box));
  } else {
    showPole(false);
    view.goTo(box, padding());
  }
}

function unchoose() {
  const id = chosen?.id;
  chosen = null;
  byId("detail").hidden = true;
  byId("all").hidden = false;
  moveTo(t);
  const n = list.reveal(id);
  list.focus(n);
}

// --- about the pole --------------------------------------------------------------------------------------------------

// Places all around a box.
const corners = ([west, south, east, north]) => [0, 0.25, 0.5, 0.75, 1].flatMap((share) => (
  [south, north].map((lat) => [west + share * (east - west), lat])));

function reachesPole() {
  const [, south, , north] = model.box();
  return model.areas.length + model.tracks.length > 0 && (north > POLE_LAT || south < -POLE_LAT);
}

// Shows the map about a pole, and some places of it; or else the map that it is without.
function showPole(isShown, places = null) {
  const wasShown = polar.isShown;
  polar.isShown = isShown;
  byId("polar").hidden = byId("polar-buttons").hidden = !isShown;
  document.querySelector(".map").classList.toggle("polar", isShown);
  byId("pole").setAttribute("aria-pressed", isShown);
  byId("pole").hidden = !isShown && !reachesPole();
  if (!isShown) return;
  if (places) polar.goTo(places);
  if (!wasShown) polarTake();
}

// Whatever lies about the pole that the scene is nearer to.
function poleOfScene() {
  const [west, south, east, north] = model.box();
  const isNorth = north >= -south;
  return corners(isNorth ? [west, Math.max(south, POLE_LAT), east, north] : [west, south, east, Math.min(north, -POLE_LAT)]);
}

function polarTake() {
  if (polar.isShown) polar.take(model).catch((error) => tell(error.message, true));
}

function padding() {
  const { clientWidth, clientHeight } = byId("map");
  return Math.min(120, clientWidth / 5, clientHeight / 5);
}

function neighbour(by) {
  if (!left.length) return;
  const n = chosen ? left.findIndex(({ id }) => id === chosen.id) : by > 0 ? left.findIndex((c) => c.start >= t) - 1 : left.length;
  choose(left[Math.min(left.length - 1, Math.max(0, n + by))]);
}

async function acknowledge(conflict, reason) {
  await source.acknowledge(conflict.a, conflict.b, reason);
  await changed("conflicts");
}

// --- time ------------------------------------------------------------------------------------------------------------

function pause() {
  if (playing === null) return;
  cancelAnimationFrame(playing);
  playing = null;
  byId("play").classList.remove("playing");
  byId("play").setAttribute("aria-label", "Play");
}

function play() {
  const button = byId("play");
  button.classList.add("playing");
  button.setAttribute("aria-label", "Pause");
  if (t >= model.span[1]) moveTo(model.span[0]);
  let before = performance.now();
  const step = (now) => {
    moveTo(t + ((now - before) / 1000) * Number(byId("speed").value));
    before = now;
    if (t >= model.span[1]) pause();
    else playing = requestAnimationFrame(step);
  };
  playing = requestAnimationFrame(step);
}

function offerSpeeds() {
  const wanted = (model.span[1] - model.span[0]) / PLAYED_S;
  const nearest = SPEEDS.reduce((best, s) => (Math.abs(Math.log(s / wanted)) < Math.abs(Math.log(best / wanted)) ? s : best));
  const names = { 1: "as it is", 10: "10 s", 60: "1 min", 300: "5 min", 900: "15 min", 3600: "1 h", 21600: "6 h", 86400: "1 day", 604800: "1 week" };
  byId("speed").replaceChildren(...SPEEDS.map((s) => new Option(s === 1 ? names[s] : `${names[s]}/s`, s, s === nearest, s === nearest)));
}

// --- changes ---------------------------------------------------------------------------------------------------------

let reading = null;
let wanted = null;

// Reads again what changed; what changes meanwhile is read after that, once.
async function changed(what) {
  wanted = what === "objects" || wanted === "objects" || model.refused !== null ? "objects" : what;
  reading ??= (async () => {
    try {
      while (wanted) {
        const now = wanted;
        wanted = null;
        await (now === "objects" ? readAll() : readConflicts());
        taken(now);
      }
    } catch (error) {
      if (error.isRefusal) forget(error.message);
      tell(error.message, true);
    } finally {
      reading = null;
    }
  })();
  return reading;
}

function taken(what) {
  take(what);
  view.reveal(true);
  view.renew(version, what === "objects" ? undefined : ["conflicts"]);
  describe();
  if (chosen) {
    chosen = model.conflicts.find(({ id }) => id === chosen.id) ?? model.conflicts.find(({ a, b }) => a === chosen.a && b === chosen.b) ?? null;
    if (chosen) detail.show(chosen, model, source.pair(chosen.a, chosen.b), model.scene.may_acknowledge);
    else unchoose();
  }
  applyFilter();
  moveTo(t);
}

// Shows nothing more of a scene that may no longer be seen, or is no more, until it is there again.
function forget(why) {
  const { scene, span } = model;
  model = new Model({ ...scene, is_current: false });
  Object.assign(model, { span, refused: why });
  pause();
  if (chosen) unchoose();
  byId("detail").replaceChildren();
  take("objects");
  view.reveal(false);
  describe();
  applyFilter();
  moveTo(t);
}

// Gives what changed to those that draw it.
function take(what) {
  if (what === "objects") havens.take(model.tracks, model.areas);
  if (model.refused === null) polarTake();
  else showPole(false);
  if (!view.overview) return;
  view.overview.takeConflicts(model.conflicts);
  if (what === "conflicts") return;
  const halfPixel = 0.5 / (512 * 2 ** view.detailZoom);
  const known = new Map(model.areas.map((area) => [area.id, area]));
  const outlines = model.outlines.map(({ id, rings }) => ({ object: known.get(id), rings })).filter(({ object }) => object);
  view.overview.take(outlines, havens.lines(halfPixel));
}

// --- what people do --------------------------------------------------------------------------------------------------

function readFilter() {
  const instant = (id, none) => instantOf(byId(id).value) ?? none;
  const number = (id, none) => (byId(id).value === "" ? none : Number(byId(id).value));
  filter.text = byId("words").value;
  filter.verdicts = new Set([...document.querySelectorAll("input[name=verdict]:checked")].map(({ value }) => value));
  [filter.from, filter.to] = [instant("from", -Infinity), instant("to", Infinity)];
  [filter.floor, filter.ceiling] = [number("floor", -Infinity), number("ceiling", Infinity)];
  filter.now = byId("now").checked;
  filter.open = byId("open").checked;
  applyFilter();
  moveTo(t);
}

// Says of what is no time that it is none: when it was written, not while it is.
function checkInstants() {
  const wrong = ["from", "to"].map(byId).filter((field) => {
    const isWrong = field.value.trim() !== "" && instantOf(field.value) === null;
    field.setAttribute("aria-invalid", isWrong);
    return isWrong;
  });
  byId("instants").textContent = wrong.length ? "A time is written as 2026-06-01 09:30, in UTC." : "";
}

function listen() {
  byId("filter").addEventListener("input", readFilter);
  byId("filter").addEventListener("change", checkInstants);
  byId("filter").addEventListener("reset", () => setTimeout(() => { checkInstants(); readFilter(); }));
  byId("filter").addEventListener("submit", (event) => event.preventDefault());
  byId("play").addEventListener("click", () => (playing === null ? play() : pause()));
  byId("before").addEventListener("click", () => neighbour(-1));
  byId("after").addEventListener("click", () => neighbour(1));
  const nameTheme = () => {
    byId("theme").textContent = { system: "Auto", light: "Light", dark: "Dark" }[theme.choice];
    byId("theme").setAttribute("aria-label", `${byId("theme").textContent} colours`);
  };
  byId("theme").addEventListener("click", () => { theme.next(); nameTheme(); havens.draw(); });
  nameTheme();
  if (view.overview) view.map.on("zoomend", mark);
  const clicked = (on, place) => {
    const [id] = (on === polar ? polar : view).conflictsAt(place);
    const conflict = model.conflicts.find((one) => one.id === id);
    if (conflict) {
      choose(conflict);
      return;
    }
    const object = on.at(place);
    if (object) {
      if (chosen) unchoose();
      byId("words").value = printable(object.key);
      readFilter();
    }
  };
  view.map.on("click", ({ point }) => clicked(havens, point));
  polar.onClick = (place) => clicked(polar, place);
  byId("pole").addEventListener("click", () => showPole(!polar.isShown, poleOfScene()));
  byId("polar-closer").addEventListener("click", () => polar.zoom(2));
  byId("polar-wider").addEventListener("click", () => polar.zoom(0.5));
  // Canvases are printed as they are on the screen: Chromium does not scale what is drawn on them from here on, except WebGL,
  // whose picture is gone by now.
  for (const [event, isPrinted] of [["beforeprint", true], ["afterprint", false]]) {
    window.addEventListener(event, () => {
      list.print(isPrinted);
      havens.isStill = polar.isStill = isPrinted;
      view.map.redraw();
    });
  }
  document.addEventListener("keydown", (event) => {
    const isTyping = event.target.closest("input:not([type=checkbox]):not([type=range]), select, textarea");
    if (event.ctrlKey || event.metaKey || event.altKey || (isTyping && event.key !== "Escape")) return;
    // The map has keys of its own for its scale.
    const isMap = event.target.closest("#map") && ["+", "=", "-"].includes(event.key);
    const does = isMap ? null : {
      j: () => neighbour(1), k: () => neighbour(-1), "/": () => { if (chosen) unchoose(); byId("words").focus(); },
      Escape: () => (chosen ? unchoose() : event.target.blur()),
      "+": () => timeline.zoom(0.5), "=": () => timeline.zoom(0.5), "-": () => timeline.zoom(2), 0: () => timeline.showAll(),
      " ": event.target.closest("button, summary, a, input:not([type=range])") ? null : () => (playing === null ? play() : pause()),
    }[event.key];
    if (does) {
      event.preventDefault();
      does();
    }
  });
}

async function start() {
  await readAll();
  const box = model.box();
  view = await MapView.open("map", source, box, version, hasOverview(model.scene));
  const graticule = new Graticule(byId("graticule"), view);
  havens = new Havens(byId("havens"), view);
  polar = new PolarView(byId("polar"), source, flags);
  take("objects");
  describe();
  offerSpeeds();
  listen();
  t = model.conflicts.find((c) => Number.isFinite(c.start))?.start ?? (model.tracks.length ? model.span[0] : Date.now() / 1000);
  applyFilter();
  moveTo(t);
  if (model.areas.length + model.tracks.length > 0 && Math.abs(box[1] + box[3]) / 2 > POLAR_LAT) showPole(true, poleOfScene());
  if (source.isLive) {
    source.watch(changed, (isHeard) => { if (isHeard) describe(); else tell("The server does not answer; trying again.", true); });
  }
  // For the console of a browser, and tests.
  globalThis.conflictdbPage = { view, havens, polar, graticule, timeline, filter, get model() { return model; }, get t() { return t; } };
  await view.loaded;
  if (view.showsDetail()) mark();
  performance.mark("shown");
  document.documentElement.dataset.ready = "true";
}

start().catch((error) => {
  byId("problem").hidden = false;
  byId("problem").textContent = `The scene cannot be shown: ${error.message}`;
});
