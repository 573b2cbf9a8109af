// The page: joins the state to what draws it, and to what people do. Only the state (state.js) changes what is shown, chosen
// or filtered, only the player what plays; methods here change one of them, and then tell those that draw.

import { Address, addressOfScene, askedBy } from "./address.js";
import { LARGE } from "./begun.js";
import { AreaMove } from "./area_move.js";
import { Brief } from "./brief.js";
import { byId } from "./dom.js";
import { Departure } from "./departure.js";
import { Detail } from "./detail.js";
import { choose as chooseDisplay, display, here, onChange as onDisplay } from "./display.js";
import { EmbeddedSource } from "./embedded.js";
import { FilterChips } from "./filter_chips.js";
import { Finder } from "./find.js";
import { Focus } from "./focus.js";
import { about, clock, counted, day, grouped, instantOf, labelOf, printable, written, zone } from "./format.js";
import { Graticule } from "./graticule.js";
import { Havens } from "./havens.js";
import { LAYERS } from "./heights.js";
import { List } from "./list.js";
import { Live } from "./live.js";
import { MapView } from "./map.js";
import { formerConflicts, MERCATOR_END, Model, worstFirst } from "./model.js";
import { ObjectCard } from "./object_card.js";
import { Ground } from "./motion.js";
import { unpackPieces } from "./near.js";
import { nearestOf } from "./nearest.js";
import { distanceAround, kernelOf } from "./pair_distance.js";
import { Paced, Readings } from "./pace.js";
import { passesOf } from "./passes.js";
import { savePicture } from "./picture.js";
import { PlaceNames } from "./place_names.js";
import { Player } from "./player.js";
import { PolarView } from "./polar.js";
import { Scenes } from "./scenes.js";
import { SideView } from "./side_view.js";
import { ServerSource } from "./source.js";
import { State } from "./state.js";
import { Table } from "./table.js";
import { theme } from "./theme.js";
import { Timeline } from "./timeline.js";

const MARKS_MS = 120; // how often the map hears what is on, while the time moves
const REST_MS = 250; // after the last move of a plan the map hears of it: it draws all of its layers again
const DEPTHS_MS = 1500; // for so long a map that is open waits for depths before it is shown without
const PAPER_MS = 5000; // for so long a map that is printed may load and draw
const MOST_WAYPOINTS = 50; // of a track, that can be dragged
const MARKS_SHARE = 0.2; // of the time, at most, that this takes
const POLAR_LAT = 75; // degrees: what is chosen beyond is shown about the pole
const POLE_LAT = 60; // scenes that reach beyond can be
const NARROW_PX = 1200; // the legend opens on wider screens
const OBJECT_ZOOM = 11; // the most, of an object that was found

// Places all around a box.
const corners = ([west, south, east, north]) => [0, 0.25, 0.5, 0.75, 1].flatMap((share) => (
  [south, north].map((lat) => [west + share * (east - west), lat])));

// The box around places.
function around(places) {
  const [lons, lats] = [0, 1].map((n) => places.map((place) => place[n]));
  return [Math.min(...lons), Math.min(...lats), Math.max(...lons), Math.max(...lats)];
}

// A name as a shell takes it.
const quoted = (text) => (/^[\w.-]+$/.test(text) ? text : `'${printable(text).replace(/'/g, "'\\''")}'`);

function tell(text, isLost = false) {
  const place = byId("state");
  place.classList.toggle("lost", isLost);
  place.textContent = printable(text);
}

class Page {
  constructor() {
    this.source = byId("scene-data") ? new EmbeddedSource() : new ServerSource();
    this.state = new State();
    const choose = (conflict) => this.choose(conflict);
    const moveTo = (t) => this.moveTo(t);
    this.player = new Player(this.state, moveTo);
    this.list = new List(byId("list"), choose);
    this.timeline = new Timeline(
      { canvas: byId("bars"), view: byId("rows"), axis: byId("axis"), tip: byId("tip"), grouping: byId("grouping"), slider: byId("slider"), buttons: { closer: byId("closer"), wider: byId("wider"), whole: byId("whole") } },
      (t) => { this.player.pause(); this.moveTo(t); }, choose, (from, to) => this.filterTime(from, to),
    );
    this.side = new SideView(byId("heights"), this.timeline, (track) => this.passes(track), {
      layers: (layers) => this.changeFilter(() => { this.state.filter.layers = layers; }),
      mode: (mode) => { byId("side-view").setAttribute("aria-expanded", mode !== null); this.address.soon(); },
      time: (t) => { this.player.pause(); this.moveTo(t); },
    });
    this.chips = new FilterChips(byId("chips"), (field) => this.clearLimit(field));
    this.finder = new Finder(byId("words"), byId("found"), () => this.source.places(), {
      object: (object) => this.chooseObject(object), place: ({ lon, lat, zoom }) => this.goToPlace([lon, lat], zoom),
    });
    this.card = new ObjectCard(byId("object"), {
      whatIf: (track) => this.askWhatIf(track), brief: (object) => this.showBrief(object), close: () => this.deselect(), goTo: (object, t) => this.goToObject(object, t),
    });
    this.table = new Table(byId("table"), () => this.source.table(), {
      choose: (conflict) => { this.table.show(false); this.choose(conflict); },
      shown: (isShown) => {
        byId("as-table").setAttribute("aria-expanded", isShown);
        if (!isShown) byId("as-table").focus();
        this.address.soon();
      },
    });
    this.detail = new Detail(byId("detail"), {
      whatIf: (track) => this.askWhatIf(track), brief: (object) => this.showBrief(object), back: () => this.unchoose(), goTo: moveTo, acknowledge: (conflict, reason) => this.acknowledge(conflict, reason),
    });
    this.brief = new Brief(byId("brief"), this.source, () => this.print());
    this.kernel = kernelOf(this.source);
    this.departure = new Departure(byId("what-if"), this.source, this.kernel, {
      range: (track, s) => this.state.model.spareSpan([track.start - s, track.end + s]), change: (plan) => this.replan(plan), close: () => this.planClosed(),
      rights: () => this.state.model.scene, move: (what) => this.source.move(what), probe: (what) => this.source.probe(what),
      waypoints: (track, waypoint) => this.showWaypoints(track, waypoint), openScene: (name) => this.goToScene(name),
    });
    this.areaMove = new AreaMove(byId("what-if"), {
      change: (plan) => this.replan(plan), close: () => this.planClosed(), rights: () => this.state.model.scene, move: (what) => this.source.move(what),
      probe: (what) => this.source.probe(what), plan: (key) => this.source.plan(key), openScene: (name) => this.goToScene(name),
      handle: (place) => this.view.showHandles(place && [{ name: "Area", lon: place[0], lat: place[1] }], (_, lon, lat) => this.areaMove.movePlace(lon, lat)),
    });
    this.marks = new Paced(() => this.mark(), MARKS_MS, MARKS_SHARE);
    this.isPrinting = false;
    this.resting = null; // the timer of a plan that is being moved
    this.filtering = null; // the timer of a filter that waits
    this.readings = new Readings((what) => this.readAgain(what), (error) => this.failed(error));
    this.live = this.source.isLive ? new Live(byId("live"), this.source, {
      changed: (tracks) => this.showShips(tracks), alarm: (alarm) => this.goToAlarm(alarm), newest: (t) => { this.player.pause(); this.moveTo(t); },
      label: (key) => labelOf(this.state.model.objects.get(key) ?? { key }),
    }) : null;
    this.scenes = this.source.isLive ? new Scenes(this.source, { open: (name) => this.goToScene(name), compare: (choice) => this.compare(choice) }) : null;
    this.address = new Address(() => this.shown(), (asked) => this.show(asked));
    // Made when the scene is read: view, havens, polar.
  }

  async start() {
    const missing = await this.openScene();
    await this.readAll();
    const { source, state } = this;
    const { model } = state;
    const ranked = this.readRanked();
    const box = model.box();
    const opened = await MapView.open("map", source, box, state.version, this.hasOverview(model.scene));
    await Promise.race([ranked, new Promise((done) => { setTimeout(done, DEPTHS_MS); })]);
    this.view = opened; // what follows runs at once: nobody sees a page without its other parts
    this.graticule = new Graticule(byId("graticule"), this.view);
    this.placeNames = new PlaceNames(byId("place-names"), this.view, () => source.places());
    this.havens = new Havens(byId("havens"), this.view);
    this.havens.below = () => this.placeNames.shown.map(({ box }) => box);
    this.polar = new PolarView(byId("polar"), source, () => state.flags());
    this.draw("objects");
    this.describe();
    this.player.offerSpeeds();
    this.listen();
    byId("legend").open = innerWidth > NARROW_PX;
    state.moveToWorst();
    const begun = state.t;
    this.applyFilter();
    this.moveTo(state.t);
    if (!model.isRanked) ranked.then(() => this.beginAgain(begun)); // the list has another first one
    if (model.areas.length + model.tracks.length > 0 && Math.abs(box[1] + box[3]) / 2 > POLAR_LAT) this.showPole(true, this.poleOfScene());
    if (source.isLive) {
      if (!this.scenes.shown) this.scenes.read(model.scene.scene);
      this.live.read();
      source.watch(state.version, (what) => (what === "live" ? this.live.read() : this.changed(what)), (isHeard) => {
        if (isHeard) this.describe();
        else tell("The server does not answer; trying again.", true);
      });
    }
    // For the console of a browser, and tests.
    const { view, havens, polar, graticule, timeline, side, placeNames, departure, areaMove } = this;
    globalThis.conflictdbPage = {
      view, havens, polar, graticule, timeline, side, placeNames, departure, areaMove, filter: state.filter, get model() { return state.model; }, get t() { return state.t; },
      moveTo: (t) => this.moveTo(t), flags: () => state.flags(), passes: (track) => this.passes(track), nearest: (key) => this.nearest(key),
    };
    await view.loaded;
    byId("coming").hidden = true;
    if (missing !== null) history.replaceState(null, "", location.pathname + location.search);
    await this.address.begin();
    if (missing !== null) tell(`The scene ${missing} was deleted, renamed or unshared: this is another one.`, true);
    view.map.on("moveend", () => this.address.soon());
    if (view.showsDetail()) this.marks.now();
    performance.mark("shown");
    document.documentElement.dataset.ready = "true";
  }

  // --- the scene -----------------------------------------------------------------------------------------------------

  // Finds the scene that the address asks for. Returns its name if it is not there, or else null.
  async openScene() {
    if (!this.source.isLive) return null;
    const { scene } = askedBy(location.hash);
    if (scene === null) return null;
    const { usual, scenes } = await this.source.scenes();
    const isThere = scenes.some((one) => one.scene === scene);
    this.source.name = isThere ? scene : usual;
    this.scenes.take(scenes, this.source.name);
    return isThere ? null : scene;
  }

  // Opens another scene of the database.
  goToScene(name) {
    this.address.flush();
    history.pushState(null, "", addressOfScene(name));
    location.reload();
  }

  // Counts changes from an instant of the history, or from another scene; null: from now on.
  async compare(choice) {
    const { state } = this;
    if (choice === null) {
      state.dismissChanges();
      this.showChanges(false);
      return;
    }
    try {
      state.compare({ ...await (choice.scene === undefined ? this.knownAt(choice.t) : this.otherScene(choice.scene)), label: choice.scene === undefined ? `Since ${choice.label}` : `Compared with ${choice.label}` });
    } catch (error) {
      this.scenes.reset();
      tell(error.message, true);
      return;
    }
    this.showChanges(state.changes.conflicts.length > 0);
  }

  async knownAt(t) {
    const { refusal, conflicts } = await this.source.known(t);
    if (refusal !== null) throw new Error(`The instant ${refusal}`);
    return { objects: this.state.model.objects, conflicts: formerConflicts(conflicts) };
  }

  async otherScene(name) {
    const source = new ServerSource(name);
    const [scene, conflicts, areas, tracks] = await Promise.all([source.scene(), source.conflicts(), source.areas(), source.tracks()]);
    const model = new Model({ ...scene, ground: await this.groundOf(scene) });
    model.takeObjects(areas, tracks, null);
    model.takeConflicts(conflicts);
    return model;
  }

  // --- reading -------------------------------------------------------------------------------------------------------

  async readAll() {
    const { source } = this;
    const scene = await source.scene();
    const [conflicts, areas, tracks, outlines, ground] = await Promise.all([
      source.conflicts(), source.areas(), source.tracks(), this.hasOverview(scene) ? source.overview() : null, this.groundOf(scene),
    ]);
    this.state.takeAll({ ...scene, ground }, areas, tracks, outlines, conflicts);
  }

  // Where the tracks of a scene move.
  async groundOf({ plane }) {
    return Ground.of(await this.kernel(), plane);
  }

  async readConflicts() {
    const scene = { ...await this.source.scene(), ground: this.state.model.scene.ground };
    this.state.takeConflicts(scene, await this.source.conflicts());
  }

  // Begins at the worst conflict, if nobody has moved the time, or looks at something, since it began.
  beginAgain(begun) {
    const { state } = this;
    if (state.t !== begun || state.chosen || this.departure.isOpen || !state.model.isRanked) return;
    state.moveToWorst();
    this.moveTo(state.t);
  }

  // Which conflicts are the worst: the server computes it, and the list waits for nothing.
  async readRanked() {
    if (this.state.model.conflicts.length === 0) return;
    try {
      this.state.takeRanked(await this.source.depths());
    } catch {
      return; // the list is by time
    }
    if (this.view) this.applyFilter();
    this.brief.draw();
  }

  hasOverview({ objects }) {
    return this.view ? this.view.overview !== null : this.source.isLive && objects > LARGE;
  }

  // Reads again what changed; of a scene that was refused, all.
  changed(what) {
    return this.readings.want(this.state.model.refused === null ? what : "objects");
  }

  async readAgain(what) {
    await (what === "objects" ? this.readAll() : this.readConflicts());
    const { state, view } = this;
    this.draw(what);
    view.reveal(true);
    view.renew(state.version, what === "objects" ? undefined : ["conflicts"]);
    this.describe();
    this.readRanked();
    this.brief.takeAgain(state.model);
    if (state.chosen) {
      state.chooseAgain();
      if (state.chosen) this.showDetail();
      else this.unchoose();
    }
    if (this.areaMove.isOpen) {
      const area = state.model.objects.get(this.areaMove.key);
      if (area?.kind === "area") await this.areaMove.readAgain(area, this.othersOf(area.key));
      else this.areaMove.close();
    }
    if (this.departure.isOpen) {
      const track = state.model.objects.get(this.departure.key);
      if (track?.kind === "track") await this.departure.readAgain(track);
      else this.departure.close();
    }
    if (state.selected !== null) this.select(state.selected);
    this.applyFilter();
    this.moveTo(state.t);
  }

  failed(error) {
    if (error.isRefusal) this.forget(error.message);
    tell(error.message, true);
  }

  // Shows nothing more of a scene that may no longer be seen, or is no more, until it is there again.
  forget(why) {
    const { state } = this;
    state.forget(why);
    this.player.pause();
    if (state.chosen) this.unchoose();
    this.closeWhatIf();
    byId("detail").replaceChildren();
    this.select(null);
    this.brief.takeAgain(state.model);
    this.table.show(false);
    this.live?.forget();
    this.draw("objects");
    this.view.reveal(false);
    this.describe();
    this.applyFilter();
    this.moveTo(state.t);
  }

  async acknowledge(conflict, reason) {
    await this.source.acknowledge(conflict.a, conflict.b, reason);
    await this.changed("conflicts");
  }

  // --- showing -------------------------------------------------------------------------------------------------------

  // Gives what was read, "objects" or "conflicts", to those that draw it.
  draw(what) {
    const { state: { model }, view, havens } = this;
    if (what === "objects") {
      havens.take(model.tracks, model.areas);
      this.finder.take([...model.areas, ...model.tracks]);
    }
    if (model.refused === null) this.drawPole();
    else this.showPole(false);
    if (!view.overview) return;
    view.overview.takeConflicts(model.conflicts);
    if (what === "conflicts") return;
    const halfPixel = 0.5 / (512 * 2 ** view.detailZoom);
    const known = new Map(model.areas.map((area) => [area.id, area]));
    const outlines = model.outlines.map(({ id, rings }) => ({ object: known.get(id), rings })).filter(({ object }) => object);
    view.overview.take(outlines, havens.lines(halfPixel));
  }

  describe() {
    const { model } = this.state;
    const { scene } = model;
    document.title = `${printable(scene.scene)} · conflictdb`;
    byId("title").textContent = printable(scene.scene);
    tell([counted(model.areas.length, "area"), counted(model.tracks.length, "track"),
      scene.is_current ? null : scene.remark,
      scene.method === "screen" ? "method screen finds no places: conflicts are in the list only"
        : scene.regions === "off" ? "no regions: conflicts are shown at their first contact" : null,
      scene.copied ? `as of ${scene.copied}, changes since are not in this file` : null].filter(Boolean).join(" · "));
    byId("beyond").hidden = model.beyond === 0;
    byId("beyond").textContent = `${counted(model.beyond, "object")} ${model.beyond === 1 ? "reaches" : "reach"} beyond `
      + `${MERCATOR_END.toFixed(2)}° of latitude, where Web Mercator ends: the polar view shows what lies there.`;
    byId("pole").hidden = !this.polar.isShown && !this.reachesPole();
    const stale = model.conflicts.filter((c) => !c.is_current).length;
    byId("stale").hidden = stale === 0;
    byId("stale").textContent = `${counted(stale, "conflict")} (hatched) ${stale === 1 ? "is" : "are"} of objects that changed since: `
      + "detect again to know what holds now.";
    this.scenes?.showBranch(model.refused === null ? scene.branch_of : null, scene.may_edit);
    this.describeChanges();
    byId("open-choice").hidden = !scene.may_acknowledge && !model.conflicts.some((c) => c.acknowledged_by !== null);
  }

  describeChanges() {
    const { changes: { text }, showsChanges } = this.state;
    byId("changes").hidden = text === null;
    if (byId("changed").textContent !== (text ?? "")) byId("changed").textContent = text ?? "";
    byId("show-changes").textContent = showsChanges ? "Show all" : "Show";
  }

  // Shows what changed alone, or all conflicts.
  showChanges(isShown) {
    const { state } = this;
    if (state.chosen) this.unchoose();
    if (isShown) this.closeWhatIf();
    state.showsChanges = isShown;
    this.describeChanges();
    this.applyFilter();
    this.showInstant();
  }

  // What the filter leaves: in the list, on the timeline and on the map, there later if `isQuick`.
  applyFilter(isQuick = false) {
    const { state } = this;
    const { model, filter } = state;
    state.applyFilter();
    const { left } = state;
    this.list.take(worstFirst(left), model, this.whyEmpty());
    const isWithin = Number.isFinite(filter.from) || Number.isFinite(filter.to);
    this.timeline.take(left, model.span, isWithin ? [Math.max(filter.from, model.span[0]), Math.min(filter.to, model.span[1])] : null, model.objects);
    this.side.take(state.side());
    this.chips.take(filter);
    this.table.take(left.filter(({ id }) => id > 0), state.version, model.scene.scene);
    const isKnown = model.conflicts.length > 0 || model.scene.is_current;
    byId("count").textContent = !isKnown ? "" : state.showsChanges ? counted(left.length, "change") : filter.isNothing() ? counted(left.length, "conflict")
      : `${grouped(left.length)} of ${counted(model.conflicts.length, "conflict")}`;
    this.havens.marks.hidden = state.hiddenObjects;
    clearTimeout(this.resting);
    if (isQuick) this.resting = setTimeout(() => this.marks.now(), REST_MS);
    else this.marks.now();
  }

  // Changes the filter, as a step that Back takes back.
  changeFilter(change) {
    this.address.flush();
    change();
    this.readFilter();
    this.address.step();
  }

  // Leaves what is on between two instants, outward to seconds; null: that end stays as it is.
  filterTime(from, to) {
    this.changeFilter(() => {
      if (from !== null) byId("from").value = written(Math.floor(from));
      if (to !== null) byId("to").value = written(Math.ceil(to));
    });
  }

  // Reads heights that change, once for each version.
  readHeights() {
    const { version, model } = this.state;
    if (this.heightsOf?.version !== version) {
      const read = this.source.heights().then((heights) => model.takeHeights(heights));
      this.heightsOf = { version, read };
      read.catch(() => { this.heightsOf = null; });
    }
    return this.heightsOf.read;
  }

  // When a track passes others, by their keys, which is computed once for each version; null: no track.
  async passes(track) {
    await this.readHeights();
    if (!track) return new Map();
    const { version } = this.state;
    if (this.passed?.version !== version || this.passed.key !== track.key) {
      const found = Promise.all([this.kernel(), this.source.pieces(track.key, 0)]).then(([kernel, pieces]) => passesOf(kernel, unpackPieces(pieces), track.key));
      this.passed = { version, key: track.key, found };
      found.catch(() => { this.passed = null; });
    }
    return this.passed.found;
  }

  // What an object comes nearest to.
  async nearest(key) {
    return nearestOf(await this.kernel(), this.source, key);
  }

  filterSoon() {
    this.filtering ??= setTimeout(() => { this.filtering = null; this.applyFilter(); }, MARKS_MS);
  }

  // Why the list shows nothing, where that is so.
  whyEmpty() {
    const { scene, areas, tracks, conflicts, refused } = this.state.model;
    if (refused !== null) return `The scene is no longer shown: ${refused}.`;
    if (conflicts.length) return "The filter leaves no conflict.";
    if (areas.length + tracks.length === 0) {
      return `The scene has no plans yet. Load some: conflictdb load FILE --scene ${quoted(scene.scene)} (GeoJSON, CSV, RTZ, GPX, KML and others). They show here at once.`;
    }
    return scene.is_current ? "No two objects are in conflict." : `No conflict is known yet (${scene.remark}).`;
  }

  // Tells the map what is on at the time that is shown, what is hidden and what is chosen. Returns how long that took an overview,
  // milliseconds.
  mark() {
    const { state: { model }, view } = this;
    this.showAhead();
    this.polar.draw();
    const flagsOf = this.state.flags();
    let took = 0;
    if (view.overview) {
      const before = performance.now();
      view.overview.mark(flagsOf);
      took = performance.now() - before;
      if (!view.showsDetail()) return took;
    }
    for (const kind of ["areas", "tracks", "conflicts"]) view.show(kind, model[kind].map((one) => [one.id, flagsOf(one)]));
    return took;
  }

  // --- the instant ---------------------------------------------------------------------------------------------------

  // `isAlone`: only the time has changed.
  moveTo(at, isAlone = true) {
    this.state.moveTo(at);
    this.showInstant();
    if (isAlone) this.marks.soon();
    else this.marks.now();
    if (this.state.filter.now) this.filterSoon();
  }

  // All but the layers of the map.
  showInstant() {
    this.address.soon();
    const { state, havens, polar } = this;
    const { t, chosen } = state;
    byId("clock").textContent = clock(t);
    byId("clock").dateTime = new Date(t * 1000).toISOString();
    byId("day").textContent = `${zone(t)}, ${day(t)}`;
    this.timeline.mark(t, chosen?.id ?? null);
    this.side.mark(t);
    this.list.show(t, chosen?.id ?? null);
    this.detail.mark(t);
    havens.t = polar.t = t;
    havens.marks.inConflict = polar.inConflict = state.inConflict();
    havens.marks.pair = state.pair();
    havens.marks.isChosen = chosen !== null;
    havens.draw();
    polar.draw();
  }

  // What follows the number of conflicts in the headline.
  showAhead() {
    const { left } = this.state;
    const { now, next } = this.state.ahead();
    const text = left.length === 0 ? "" : `, ${grouped(now)} now, ${next === null ? "none later" : `next in ${about(next)}`}`;
    if (byId("ahead").textContent !== text) byId("ahead").textContent = text;
  }

  // --- the conflict that is chosen -----------------------------------------------------------------------------------

  choose(conflict) {
    const { state } = this;
    this.player.pause();
    this.address.flush();
    if (conflict.since === "gone" || (conflict.change && conflict.change !== "gone")) { // nothing more is known
      this.moveTo(conflict.start);
      return;
    }
    state.choose(conflict);
    this.side.take(state.side());
    byId("all").hidden = true;
    byId("detail").hidden = false;
    this.showDetail();
    this.moveTo(Number.isFinite(conflict.start) ? conflict.start : state.t, false);
    this.goToBox(state.model.around(conflict, state.t));
    this.address.step();
  }

  // Shows a box, on the map or about the pole.
  goToBox(box, mostZoom) {
    const lat = (box[1] + box[3]) / 2;
    if (Math.abs(lat) > POLAR_LAT || (this.polar.isShown && Math.abs(lat) > POLE_LAT)) {
      this.showPole(true, corners(box));
    } else {
      this.showPole(false);
      const { clientWidth, clientHeight } = byId("map");
      this.view.goTo(box, Math.min(120, clientWidth / 5, clientHeight / 5), mostZoom);
    }
  }

  unchoose(isStep = true) {
    const { state } = this;
    if (isStep) this.address.flush();
    const id = state.chosen?.id;
    state.choose(null);
    this.side.take(state.side());
    this.havens.focus = null;
    byId("detail").hidden = true;
    byId("all").hidden = false;
    this.moveTo(state.t, false);
    const n = this.list.reveal(id);
    this.list.focus(n);
    if (isStep) this.address.step();
  }

  // Selects an object by its key, if there is one; null: none.
  select(key) {
    const { state } = this;
    state.selected = state.model.objects.has(key) ? key : null;
    this.side.take(state.side());
    this.showCard();
  }

  // The card of the selected object.
  showCard() {
    const { model, selected } = this.state;
    const object = model.objects.get(selected);
    if (!object) {
      this.card.hide();
      return;
    }
    const count = model.conflictsOf(selected).length;
    this.card.show(object, count, { isCurrent: model.scene.is_current, asksWhatIf: this.departure.key !== selected && this.areaMove.key !== selected, maySendAway: this.source.isLive },
      () => this.nearest(selected));
  }

  // An object that was found: its conflicts alone, and where it is.
  chooseObject(object) {
    this.address.flush();
    if (this.state.chosen) this.unchoose(false);
    this.closeWhatIf();
    this.select(object.key);
    byId("words").value = printable(object.key);
    this.readFilter();
    this.goToObject(object);
    this.address.step();
  }

  deselect() {
    this.address.flush();
    const { selected } = this.state;
    this.closeWhatIf();
    if (selected !== null && byId("words").value === printable(selected)) byId("words").value = "";
    this.select(null);
    this.readFilter();
    byId("words").focus();
    this.address.step();
  }

  // Shows an object where it is, or was and will be, at an instant.
  goToObject(object, t = this.state.t) {
    this.player.pause();
    const [from, to] = [object.start ?? -Infinity, object.end ?? Infinity];
    const at = Math.min(Math.max(t, from), Math.max(from, to - 1e-3));
    if (at !== this.state.t) this.moveTo(at);
    const ring = object.kind === "track" ? object.motion.haven(at) : [object.box.slice(0, 2), object.box.slice(2)];
    this.goToBox(around(ring), OBJECT_ZOOM);
  }

  // Last positions on the map, by the key of their track.
  showShips(tracks) {
    byId("ships").hidden = tracks.size === 0;
    this.havens.live = tracks;
    this.havens.draw();
  }

  // Where and when a conflict would be that follows from lateness; else where the ship is.
  goToAlarm({ key, first, lon, lat }) {
    const ship = this.live.tracks.get(key);
    const places = [...(lon === null ? [] : [[lon, lat]]), ...(ship ? [[ship.lon, ship.lat]] : [])];
    this.player.pause();
    if (this.state.chosen) this.unchoose();
    if (this.state.model.objects.has(key)) this.select(key);
    if (first !== null) this.moveTo(first);
    else if (ship) this.moveTo(ship.t);
    if (places.length) this.goToBox(around(places), OBJECT_ZOOM);
  }

  goToPlace([lon, lat], zoom) {
    this.address.flush();
    byId("words").value = "";
    this.readFilter();
    this.goToBox([lon, lat, lon, lat], zoom);
    this.address.step();
  }

  // Takes one limit of the filter away.
  clearLimit(field) {
    if (field === "words" && this.state.selected !== null && byId("words").value === printable(this.state.selected)) {
      this.deselect();
      return;
    }
    this.changeFilter(() => {
      if (field === "layers") {
        this.side.takeLayers(new Set(LAYERS));
        this.state.filter.layers = this.side.layers;
      } else if (field === "verdicts") {
        for (const box of document.querySelectorAll("input[name=verdict]")) box.checked = true;
      } else if (field === "now" || field === "open") {
        byId(field).checked = false;
      } else {
        byId(field).value = "";
      }
    });
    checkInstants();
    this.finder.hide();
    if (!byId("chips").contains(document.activeElement)) byId("words").focus();
  }

  // --- a track that departs at another time --------------------------------------------------------------------------

  askWhatIf(object) {
    if (object.kind === "area") return this.askAreaMove(object);
    const track = object;
    const { state } = this;
    this.areaMove.close();
    this.address.flush();
    const pair = state.pair();
    if (state.chosen) this.unchoose(false);
    state.hues = pair.includes(track.key) ? pair : [track.key]; // both keep their colours
    this.select(track.key);
    byId("words").value = printable(track.key);
    this.readFilter();
    const opened = this.departure.open(track, state.model.scene.scene, state.hueOf(track.key));
    this.showCard();
    this.address.step();
    return opened;
  }

  // What if an area moved.
  askAreaMove(area) {
    const { state } = this;
    this.address.flush();
    this.departure.close();
    if (state.chosen) this.unchoose(false);
    state.hues = [area.key];
    this.select(area.key);
    byId("words").value = printable(area.key);
    this.readFilter();
    this.address.step();
    const opened = this.areaMove.open(area, state.model.scene.scene, this.othersOf(area.key));
    this.showCard();
    return opened;
  }

  // The keys of those that an object is in conflict with.
  othersOf(key) {
    return this.state.model.conflictsOf(key).map(({ a, b }) => (a === key ? b : a));
  }

  // Shows the conflicts and the haven of a moved plan; null: as planned.
  replan(plan) {
    const { state, havens } = this;
    state.plan = havens.plan = plan;
    if (plan) state.showsChanges = false;
    this.describeChanges();
    this.applyFilter(plan !== null);
    this.showInstant();
    if (plan) this.showGhost();
  }

  // Shows where a moved plan is, and was, once it rests; a waypoint that is dragged is in view.
  showGhost() {
    clearTimeout(this.ghosting);
    this.ghosting = setTimeout(() => {
      const { plan, model, t } = this.state;
      const track = plan && model.objects.get(plan.key);
      if (track?.kind !== "track" || plan.waypoint) return;
      const ringAt = (at) => track.motion.haven(Math.min(Math.max(at, track.start), track.end - 1e-3)) ?? [];
      const ghost = ringAt(t - plan.laterUs / 1e6);
      if (!ghost.length || this.view.holds(ghost)) return;
      this.goToBox(around([...ghost, ...ringAt(t)]), OBJECT_ZOOM);
    }, REST_MS);
  }

  // Waypoints that can be dragged, of which one may be elsewhere; null: none.
  showWaypoints(track, waypoint = null) {
    const isAble = track !== null && track.motion.points.length <= MOST_WAYPOINTS;
    const handles = isAble ? track.motion.points.map(({ lon, lat }, n) => (
      { name: `Waypoint ${n + 1}`, ...(waypoint?.[0] === n ? { lon: waypoint[1], lat: waypoint[2] } : { lon, lat }) })) : null;
    this.view.showHandles(handles, (n, lon, lat) => this.departure.moveWaypoint(n, lon, lat), this.departure.hue);
  }

  closeWhatIf() {
    this.departure.close();
    this.areaMove.close();
  }

  planClosed() {
    this.state.hues = null;
    this.state.model.spareSpan(null);
    this.replan(null);
    this.moveTo(this.state.t);
    this.address.step();
    byId("words").focus();
  }

  chooseNeighbour(by) {
    const conflict = this.state.neighbour(by);
    if (conflict) this.choose(conflict);
  }

  showDetail() {
    const { chosen, model } = this.state;
    const track = [chosen.b, chosen.a].find((key) => model.objects.get(key)?.kind === "track");
    const distance = track === undefined ? null : distanceAround(this.source, this.kernel, chosen, track);
    const pair = this.source.pair(chosen.a, chosen.b);
    this.detail.show(chosen, model, pair, distance, model.scene.may_acknowledge);
    const focus = new Focus(chosen, model);
    this.havens.focus = focus;
    pair.then(({ footprints }) => {
      focus.takeFootprints(footprints);
      this.havens.draw();
    }, () => null); // the card says so
  }

  // --- about the pole ------------------------------------------------------------------------------------------------

  reachesPole() {
    const { model } = this.state;
    const [, south, , north] = model.box();
    return model.areas.length + model.tracks.length > 0 && (north > POLE_LAT || south < -POLE_LAT);
  }

  // Shows the map about a pole, and some places of it; or else the map that it is without.
  showPole(isShown, places = null) {
    const { polar } = this;
    const wasShown = polar.isShown;
    polar.isShown = isShown;
    byId("polar").hidden = byId("polar-buttons").hidden = !isShown;
    document.querySelector(".map").classList.toggle("polar", isShown);
    byId("pole").setAttribute("aria-pressed", isShown);
    byId("pole").hidden = !isShown && !this.reachesPole();
    if (!isShown) return;
    if (places) polar.goTo(places);
    if (!wasShown) this.drawPole();
  }

  // Whatever lies about the pole that the scene is nearer to.
  poleOfScene() {
    const [west, south, east, north] = this.state.model.box();
    const isNorth = north >= -south;
    return corners(isNorth ? [west, Math.max(south, POLE_LAT), east, north] : [west, south, east, Math.min(north, -POLE_LAT)]);
  }

  drawPole() {
    if (this.polar.isShown) this.polar.take(this.state.model).catch((error) => tell(error.message, true));
  }

  // --- the address ---------------------------------------------------------------------------------------------------

  shown() {
    const { state, departure } = this;
    const value = (id) => byId(id).value.trim();
    return {
      scene: state.model.scene.scene, t: state.t, view: this.view.place(), chosen: state.chosen, selected: state.selected, side: this.side.mode, rows: byId("grouping").value, table: this.table.isShown,
      filter: {
        object: byId("words").value, verdicts: [...state.filter.verdicts], from: value("from"), to: value("to"),
        layers: [...state.filter.layers], floor: value("floor"), ceiling: value("ceiling"), now: state.filter.now, open: state.filter.open,
      },
      departure: departure.isOpen ? departure : null,
    };
  }

  async show({ display: wanted, scene, t, view, pair, filter, departure, side, selected, rows, table }) {
    const { state } = this;
    if (scene !== null && scene !== state.model.scene.scene) {
      if (this.source.isLive) {
        location.reload(); // Back leads to another scene
        return;
      }
      tell(`The link is to the scene ${scene}: this page shows another one.`, true);
      return;
    }
    chooseDisplay(wanted);
    byId("words").value = filter.object;
    for (const name of ["floor", "ceiling"]) byId(name).value = filter[name];
    for (const name of ["from", "to"]) byId(name).value = filter[name] === "" ? "" : written(filter[name]);
    for (const name of ["now", "open"]) byId(name).checked = filter[name];
    for (const box of document.querySelectorAll("input[name=verdict]")) box.checked = filter.verdicts.includes(box.value);
    byId("grouping").value = rows;
    this.side.takeLayers(new Set(filter.layers));
    state.filter.layers = this.side.layers;
    this.readFilter();
    const track = departure && state.model.objects.get(departure.key);
    if (track?.kind === "track") {
      if (this.departure.key !== track.key) await this.askWhatIf(track);
      await this.departure.moveWithin(1e6 * departure.laterS, departure.upM);
      byId("words").value = filter.object;
      this.readFilter();
    } else {
      this.closeWhatIf();
    }
    const conflict = pair && state.model.conflicts.find(({ a, b }) => a === pair[0] && b === pair[1]);
    if (conflict) this.choose(conflict);
    else if (state.chosen) this.unchoose();
    if (!conflict) this.select(selected);
    this.side.show(side);
    this.table.show(table);
    if (t !== null) this.moveTo(t);
    if (view) this.view.jumpTo(view);
  }

  async copyLink() {
    this.address.write(false);
    try {
      await navigator.clipboard.writeText(location.href);
      byId("link").textContent = "Copied";
    } catch {
      byId("link").textContent = "See the address";
    }
    setTimeout(() => { byId("link").textContent = "Copy link"; }, 2000);
  }

  // --- units and times -----------------------------------------------------------------------------------------------

  // Offers the zones: UTC, the one that is shown, and once the menu is open that of the browser, which takes some hundredths of a second.
  offerDisplay() {
    const zones = [...new Set(["UTC", ...(byId("menu").open ? [here()] : []), display.zone])];
    byId("units").value = display.isNautical ? "nautical" : "metric";
    byId("zone").replaceChildren(...zones.map((one) => new Option(one, one, one === display.zone, one === display.zone)));
    for (const one of document.querySelectorAll(".zone")) one.textContent = zone(this.state.t);
  }

  chooseDisplay(wanted) {
    const instants = ["from", "to"].map((id) => instantOf(byId(id).value));
    this.address.flush();
    chooseDisplay({ ...display, ...wanted });
    ["from", "to"].forEach((id, n) => { if (instants[n] !== null) byId(id).value = written(instants[n]); });
    this.address.step();
  }

  // Writes all anew in other units, or another zone.
  displayChanged() {
    const { state } = this;
    this.offerDisplay();
    this.view.showUnits();
    this.graticule.redraw();
    this.describe();
    this.scenes?.relabel();
    this.live?.draw();
    if (state.chosen) this.showDetail();
    this.showCard();
    this.chips.shown = "";
    this.applyFilter();
    this.timeline.draw();
    this.side.draw();
    this.brief.draw();
    this.departure.rewrite();
    this.areaMove.rewrite();
    this.moveTo(state.t);
  }

  // --- paper ---------------------------------------------------------------------------------------------------------

  showBrief(object) {
    this.brief.show(object, this.state.model);
  }

  // Prints what is shown, once it is drawn for paper.
  async print() {
    if (this.isPrinting) return;
    this.isPrinting = true;
    this.player.pause();
    theme.forPaper("page", true);
    try {
      await Promise.race([
        Promise.all([this.view.idle(), this.detail.settled, this.brief.settled]), new Promise((done) => { setTimeout(done, PAPER_MS); })]);
      this.havens.draw();
      window.print();
    } finally {
      theme.forPaper("page", false);
      this.isPrinting = false;
    }
  }

  async savePicture() {
    const { state: { t, model }, view } = this;
    const above = ["graticule", "place-names", "overview", "havens", "polar"].map(byId);
    await savePicture(view.map, above, [printable(model.scene.scene), byId("headline").textContent, `${day(t)} ${clock(t)} ${zone(t)}`]);
  }

  // --- what people do ------------------------------------------------------------------------------------------------

  readFilter() {
    const { filter, t } = this.state;
    const instant = (id, none) => instantOf(byId(id).value) ?? none;
    const number = (id, none) => (byId(id).value === "" ? none : Number(byId(id).value));
    filter.text = byId("words").value;
    filter.verdicts = new Set([...document.querySelectorAll("input[name=verdict]:checked")].map(({ value }) => value));
    [filter.from, filter.to] = [instant("from", -Infinity), instant("to", Infinity)];
    [filter.floor, filter.ceiling] = [number("floor", -Infinity), number("ceiling", Infinity)];
    filter.now = byId("now").checked;
    filter.open = byId("open").checked;
    this.applyFilter();
    this.moveTo(t);
  }

  // Chooses the conflict at a pixel of a map, or else filters by the object that is there. `on` finds objects.
  clicked(on, place) {
    const { state, polar, view } = this;
    const [id] = (on === polar ? polar : view).conflictsAt(place);
    const conflict = state.model.conflicts.find((one) => one.id === id);
    if (conflict) {
      this.choose(conflict);
      return;
    }
    const object = on.at(place);
    if (object) {
      if (state.chosen) this.unchoose();
      if (object.kind === "track") {
        this.askWhatIf(object);
        return;
      }
      byId("words").value = printable(object.key);
      this.readFilter();
    }
  }

  listen() {
    const { view, havens, polar, list, state } = this;
    byId("filter").addEventListener("input", () => this.readFilter());
    byId("show-changes").addEventListener("click", () => this.showChanges(!state.showsChanges));
    byId("dismiss-changes").addEventListener("click", () => {
      state.dismissChanges();
      this.scenes?.reset();
      this.showChanges(false);
      byId("words").focus();
    });
    byId("grouping").addEventListener("change", () => this.address.soon());
    byId("as-table").addEventListener("click", () => this.table.show(!this.table.isShown));
    byId("side-view").addEventListener("click", () => this.side.show(this.side.mode === null ? "time" : null));
    byId("picture").addEventListener("click", () => this.savePicture());
    byId("link").addEventListener("click", () => this.copyLink());
    byId("print").addEventListener("click", () => this.print());
    byId("units").addEventListener("change", () => this.chooseDisplay({ isNautical: byId("units").value === "nautical" }));
    byId("zone").addEventListener("change", () => this.chooseDisplay({ zone: byId("zone").value }));
    onDisplay(() => this.displayChanged());
    byId("menu").addEventListener("toggle", () => this.offerDisplay());
    this.offerDisplay();
    document.addEventListener("click", ({ target }) => { if (!target.closest("#menu")) byId("menu").open = false; });
    byId("filter").addEventListener("change", checkInstants);
    byId("filter").addEventListener("reset", () => setTimeout(() => {
      checkInstants();
      this.side.takeLayers(new Set(LAYERS));
      state.filter.layers = this.side.layers;
      this.readFilter();
    }));
    byId("filter").addEventListener("submit", (event) => event.preventDefault());
    byId("play").addEventListener("click", () => this.player.toggle());
    byId("before").addEventListener("click", () => this.chooseNeighbour(-1));
    byId("after").addEventListener("click", () => this.chooseNeighbour(1));
    const nameTheme = () => {
      byId("theme").textContent = { system: "Auto", light: "Light", dark: "Dark" }[theme.choice];
      byId("theme").setAttribute("aria-label", `${byId("theme").textContent} colours`);
    };
    byId("theme").addEventListener("click", () => { theme.next(); nameTheme(); havens.draw(); });
    nameTheme();
    if (view.overview) view.map.on("zoomend", () => this.marks.now());
    view.map.on("click", ({ point }) => this.clicked(havens, point));
    polar.onClick = (place) => this.clicked(polar, place);
    byId("pole").addEventListener("click", () => this.showPole(!polar.isShown, this.poleOfScene()));
    byId("polar-closer").addEventListener("click", () => polar.zoom(2));
    byId("polar-wider").addEventListener("click", () => polar.zoom(0.5));
    // In the colours of paper. Then canvases are printed as they are: Chromium does not scale what is drawn on them from here on, except
    // WebGL, whose picture is gone by now.
    for (const [event, isPrinted] of [["beforeprint", true], ["afterprint", false]]) {
      window.addEventListener(event, () => {
        havens.isStill = polar.isStill = false;
        theme.forPaper("browser", isPrinted);
        havens.draw();
        polar.draw();
        list.print(isPrinted);
        havens.isStill = polar.isStill = isPrinted;
        view.map.redraw();
      });
    }
    document.addEventListener("keydown", (event) => this.pressed(event));
  }

  pressed(event) {
    const { timeline, state } = this;
    if ((event.ctrlKey || event.metaKey) && !event.altKey && !event.shiftKey && event.key.toLowerCase() === "p") {
      event.preventDefault(); // the browser would not wait until the map has the colours of paper
      this.print();
      return;
    }
    const isTyping = event.target.closest("input:not([type=checkbox]):not([type=range]), select, textarea");
    if (event.ctrlKey || event.metaKey || event.altKey || (isTyping && event.key !== "Escape")) return;
    // The map has keys of its own for its scale.
    const isMap = event.target.closest("#map") && ["+", "=", "-"].includes(event.key);
    const does = isMap ? null : {
      "[": () => this.filterTime(state.t, null), "]": () => this.filterTime(null, state.t), h: () => byId("side-view").click(), j: () => this.chooseNeighbour(1), k: () => this.chooseNeighbour(-1),
      "/": () => { if (state.chosen) this.unchoose(); byId("words").focus(); },
      Escape: () => (byId("menu").open ? (byId("menu").open = false) : this.brief.isShown ? this.brief.hide() : this.table.isShown ? this.table.show(false) : state.chosen ? this.unchoose() : this.departure.isOpen || this.areaMove.isOpen ? this.closeWhatIf() : event.target.blur()),
      "+": () => timeline.zoom(0.5), "=": () => timeline.zoom(0.5), "-": () => timeline.zoom(2), 0: () => timeline.showAll(),
      " ": event.target.closest("button, summary, a, input:not([type=range])") ? null : () => this.player.toggle(),
    }[event.key];
    if (does) {
      event.preventDefault();
      does();
    }
  }
}

// Says of what is no time that it is none: when it was written, not while it is.
function checkInstants() {
  const wrong = ["from", "to"].map(byId).filter((field) => {
    const isWrong = field.value.trim() !== "" && instantOf(field.value) === null;
    field.setAttribute("aria-invalid", isWrong);
    return isWrong;
  });
  byId("instants").textContent = wrong.length ? `A time is written as 2026-06-01 09:30, in ${display.zone}.` : "";
}

new Page().start().catch((error) => {
  byId("coming").hidden = true;
  byId("problem").hidden = false;
  byId("problem").textContent = `The scene cannot be shown: ${error.message}`;
});
