// Where the page has its scene from: the server of `conflictdb map`.

import { requested } from "./begun.js";

// Of an answer that says that there is nothing here for who asks: no scene, or no right to it.
const REFUSALS = [400, 401, 403, 404, 410];

class Unanswered extends Error {
  // status: of the answer, 0 if there was none.
  constructor(said, status) {
    super(said);
    this.isRefusal = REFUSALS.includes(status); // rather than that it does not work, or not now
  }
}

async function answered(asked) {
  let response;
  try {
    response = await asked;
  } catch {
    throw new Unanswered("the server does not answer", 0); // each browser has words of its own for it
  }
  if (response.ok) return response;
  let said = `${response.status} ${response.statusText}`;
  try {
    said = (await response.json()).error ?? said;
  } catch {
    // It said nothing that could be read.
  }
  throw new Unanswered(said, response.status);
}

// Where the page is: below the token on a server that others reach.
const root = () => new URL(".", document.baseURI).href;

const land = (detail, asked) => ({
  type: "geojson", data: `${root()}land/${detail}?${new URLSearchParams(asked)}`,
});

// A box and as much of the world on each side of it.
export function seenAround([west, south, east, north]) {
  const [width, height] = [east - west, north - south];
  return [Math.max(-180, west - width), Math.max(-90, south - height), Math.min(180, east + width), Math.min(90, north + height)];
}

export class ServerSource {
  isLive = true;
  isLeft = false; // for another scene

  // Of a scene of the server's database; null: the one that it shows first.
  constructor(name = null) {
    this.name = name;
  }

  // The address of an answer on the scene.
  at(path, asked = {}) {
    const all = new URLSearchParams({ ...asked, ...(this.name !== null && { scene: this.name }) });
    return all.size ? `${path}?${all}` : path;
  }

  // The scenes of the database, and which one a page shows first: { usual, scenes: [{ scene, conflicts, branch_of }, …] }.
  async scenes() {
    return (await answered(fetch("api/scenes"))).json();
  }

  // Conflicts as they were known at an instant (Unix seconds): { refusal, conflicts: [[a, b, verdict, error, periods], …] }.
  async known(t) {
    return (await answered(fetch(this.at("api/known", { at: new Date(1000 * t).toISOString() })))).json();
  }

  async scene() {
    const { secret, ...scene } = await (await answered(requested(this.at("api/scene")))).json();
    this.secret = secret;
    return scene;
  }

  async conflicts() {
    return (await answered(requested(this.at("api/conflicts")))).arrayBuffer();
  }

  // The conflicts, the worst first: [[id, Unix seconds, words, metres], …] (Model.takeRanked).
  async depths() {
    return (await answered(fetch(this.at("api/depths")))).json();
  }

  // How tracks keep their plans, and the conflicts that follow: { tracks: [{ key, state, t, lon, lat, … }], alarms: [{ alarm_id, key, … }] }.
  async live() {
    return (await answered(fetch(this.at("api/live")))).json();
  }

  async areas() {
    return (await answered(requested(this.at("api/areas")))).json();
  }

  async tracks() {
    return (await answered(requested(this.at("api/tracks")))).arrayBuffer();
  }

  // Outlines of areas as they are seen from afar.
  async overview() {
    return (await answered(requested(this.at("api/overview")))).arrayBuffer();
  }

  // GeoJSON of each layer, whole.
  async shapes() {
    return (await answered(fetch(this.at("api/shapes")))).json();
  }

  // CSV of all conflicts, as the command line writes it.
  async table() {
    return (await answered(fetch(this.at("api/table")))).text();
  }

  // Towns and countries: [{ name, kind, lon, lat, zoom }].
  async places() {
    this.readPlaces ??= answered(fetch("places")).then((answer) => answer.json());
    return this.readPlaces;
  }

  // Floors and ceilings of tracks whose heights change, by key.
  async heights() {
    return (await answered(fetch(this.at("api/heights")))).json();
  }

  // All land: features of polygons and of coasts.
  async landShapes() {
    return (await (await answered(fetch("land/50m"))).json()).features;
  }

  // Why two objects are in conflict, and the shapes of those that are areas.
  async pair(a, b) {
    return (await answered(fetch(this.at("api/pair", { a, b })))).json();
  }

  // The kernel as WebAssembly.
  async kernel() {
    return (await answered(requested("page/kernel.wasm"))).arrayBuffer();
  }

  // Pieces of a track, and of what it may meet if it departs that much earlier or later, with a margin, metres.
  async pieces(key, withinS, marginM = 0) {
    return (await answered(fetch(this.at("api/pieces", { key, within_s: withinS, margin_m: Math.ceil(marginM) })))).arrayBuffer();
  }

  // Pieces of an object, and of what comes within so many metres of it.
  async piecesNear(key, withinM) {
    return (await answered(fetch(this.at("api/pieces", { key, near_m: withinM })))).arrayBuffer();
  }

  acknowledge(a, b, reason) {
    return this.write("api/acknowledge", { a, b, reason });
  }

  // Stores a moved plan: { key, plan (its digest), branch, and later_us, up_m, waypoint of a track, or shift_deg, starts_us, ends_us of an area }. Returns the digest of what is stored.
  async move(what) {
    return (await (await this.write("api/move", what)).json()).plan;
  }

  // An object as a feature of a scene file, and its digest: { feature, plan }.
  async plan(key) {
    return (await answered(fetch(this.at("api/plan", { key })))).json();
  }

  // Who owns an object and those that it is in conflict with, by key.
  async owners(key) {
    return (await answered(fetch(this.at("api/owners", { key })))).json();
  }

  // Merges this branch into its parent, or drops it: "merge" or "drop".
  branch(does) {
    return this.write("api/branch", { does });
  }

  // The conflicts of a moved plan, which is not stored: { conflicts: [[other, verdict, error, periods], …], nearer }: the keys of
  // objects within the margin { s, m } of a plan without conflicts.
  async probe(what) {
    return (await this.write("api/probe", what)).json();
  }

  write(path, what) {
    return answered(fetch(this.at(path), {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Conflictdb-Secret": this.secret },
      body: JSON.stringify(what),
    }));
  }

  // Shapes in one state of the scene as MapLibre takes them, from a zoom on, and which of these each layer shows; and
  // the coarser land: of what is to be seen at first, if there is a finer one `near` the scene, which comes later.
  async sources(version, near, minzoom) {
    return {
      sources: {
        ...Object.fromEntries(["areas", "tracks", "conflicts"].map((kind) => [kind, {
          type: "vector", tiles: [this.tilesAt(kind, version)], minzoom, maxzoom: 16,
        }])),
        land: land("50m", near ? { box: seenAround(near).join() } : {}),
      },
      places: {
        areas: { source: "areas", sourceLayer: "areas" },
        tracks: { source: "tracks", sourceLayer: "tracks" },
        conflicts: { source: "conflicts", sourceLayer: "conflicts" },
        first_contacts: { source: "conflicts", sourceLayer: "first_contacts" },
      },
    };
  }

  // Land of a first view as sources: the finer one around `near`, and the coarser one elsewhere.
  landAround(near) {
    return { land: land("50m", { box: seenAround(near).join(), but: near.join() }), "near-land": land("10m", { box: near.join() }) };
  }

  // The coarser land of the world around `near`: parsing it takes the browser a second.
  landBeyond(near) {
    return { land: land("50m", { but: near.join() }) };
  }

  tilesAt(kind, version) {
    return this.at(`${root()}tiles/${kind}/{z}/{x}/{y}`, { v: version });
  }

  // Calls `told` with "objects" or "conflicts" when these changed since a version, with "live" when an alarm begins or ends, and `state` with whether changes are heard of, when that changes.
  watch(version, told, state) {
    const events = new EventSource(this.at("api/events", { version }));
    let wasLost = false;
    events.addEventListener("open", () => {
      if (!wasLost) return;
      state(true);
      told("objects"); // whatever happened meanwhile
      wasLost = false;
    });
    events.addEventListener("error", () => {
      state(false);
      wasLost = true;
    });
    for (const what of ["objects", "conflicts", "live"]) events.addEventListener(what, () => { if (!this.isLeft) told(what); });
  }
}
