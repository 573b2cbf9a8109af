// The map: land, areas, paths and conflict regions. What is on, chosen or hidden is a state of a feature, so that moving
// in time asks for no tile again.

import * as maplibregl from "../vendor/maplibre-gl.mjs";
import { Overview } from "./overview.js";
import { colour, theme } from "./theme.js";
import { mercatorX, mercatorY } from "./world.js";

maplibregl.prewarm(); // its threads load while the scene does

const state = (name) => ["boolean", ["feature-state", name], false];
// Hidden: nothing; else what holds for a feature that is chosen, on at the time that is shown, or neither.
const byState = (chosen, on, off) => ["case", state("hidden"), 0, state("chosen"), chosen, state("on"), on, off];

// What each layer looks like in the colours of the theme.
const looks = () => ({
  sea: { "background-color": colour("sea") },
  land: { "fill-color": colour("land"), "fill-antialias": false },
  coast: { "line-color": colour("coast"), "line-width": 0.8 },
  areas: { "fill-color": colour("object"), "fill-opacity": byState(0.28, 0.14, 0.03) },
  "areas-edge": {
    "line-color": colour("object"), "line-width": ["case", state("chosen"), 2, 1],
    "line-opacity": byState(1, 0.75, 0.25),
  },
  tracks: {
    "line-color": colour("object"), "line-width": ["case", state("chosen"), 2, 1],
    "line-opacity": byState(0.95, 0.4, 0.12),
  },
  conflicts: { "fill-color": colour("conflict"), "fill-opacity": byState(0.55, 0.45, 0.1) },
  "conflicts-edge": {
    "line-color": colour("conflict"), "line-width": ["case", state("chosen"), 2.5, 1.2],
    "line-opacity": byState(1, 0.95, 0.35),
  },
  "first-contacts": {
    "circle-color": colour("conflict"), "circle-radius": ["case", state("chosen"), 5, 2.5],
    "circle-opacity": byState(1, 0.9, 0.4), "circle-stroke-color": colour("paper"),
    "circle-stroke-width": ["case", state("hidden"), 0, 1],
  },
});

const KINDS = ["areas", "tracks", "conflicts"];

// Layers from below to above: id, type, and what they show.
const LAYERS = [
  ["land", "fill", "land"],
  ["coast", "line", "land"],
  ["near-land", "fill", "near-land"],
  ["near-coast", "line", "near-land"],
  ["areas", "fill", "areas"],
  ["areas-edge", "line", "areas"],
  ["tracks", "line", "tracks"],
  ["conflicts", "fill", "conflicts"],
  ["conflicts-edge", "line", "conflicts"],
  ["first-contacts", "circle", "first_contacts"],
];

const MERCATOR_M = 2 * Math.PI * 6378137;
const SMALL_DEG = 30; // around a scene that is smaller than this, with its margin, land is the finer one
const MARGIN_DEG = 5;
const MOST_TILED = 16; // the zoom of the finest tiles
const FIT = { padding: 48, maxZoom: 12 };
const FAR_ZOOMS = 3; // up to so many zooms beyond that which shows all of a large scene, tiles would hold too much

export class MapView {
  // Shows a scene in a container: box is [west, south, east, north]; a large scene has an overview.
  static async open(container, source, box, version, isLarge) {
    const detailZoom = isLarge ? detailZoomOf(box, document.getElementById(container)) : 0;
    const near = nearOf(box);
    const view = new MapView(container, source, box, detailZoom, await source.sources(version, near, detailZoom));
    if (near && source.allLand) view.loaded.then(() => view.take(source.allLand(near)));
    return view;
  }

  // Tiles are shown from detailZoom on: below, `overview` shows the scene, which is null where that is 0.
  constructor(container, source, box, detailZoom, { sources, places }) {
    this.source = source;
    this.detailZoom = detailZoom;
    this.places = places;
    this.states = new Map(KINDS.map((kind) => [kind, new Map()]));
    this.map = new maplibregl.Map({
      container,
      style: this.style(sources),
      bounds: [[box[0], Math.max(box[1], -85)], [box[2], Math.min(box[3], 85)]],
      fitBoundsOptions: FIT,
      dragRotate: false,
      pitchWithRotate: false,
      touchPitch: false,
      maxPitch: 0,
      maxZoom: 19,
      attributionControl: false,
      fadeDuration: 0,
      refreshExpiredTiles: false,
    });
    this.map.touchZoomRotate.disableRotation();
    this.map.keyboard.disableRotation();
    this.map.addControl(new maplibregl.NavigationControl({ showCompass: false }), "top-right");
    this.map.addControl(new maplibregl.ScaleControl({ maxWidth: 140 }), "bottom-left");
    this.map.getCanvas().setAttribute("aria-label", "Map");
    theme.onChange(() => this.paint());
    this.isReady = false; // for states of features
    this.map.once("style.load", () => { this.isReady = true; });
    this.overview = detailZoom > 0
      ? new Overview(document.getElementById("overview"), this, () => !this.showsDetail() || !this.isDetailLoaded()) : null;
    this.loaded = new Promise((resolve) => this.map.once("load", resolve));
  }

  style(sources) {
    const layers = LAYERS.filter(([, , from]) => from in sources || from in this.places).map((one) => this.layer(one));
    return { version: 8, sources, layers: [{ id: "sea", type: "background", paint: looks().sea }, ...layers] };
  }

  layer([id, type, from]) {
    const kind = (id) => /^(near-)?(land|coast)$/.test(id) && { filter: ["==", ["get", "kind"], id.replace("near-", "")] };
    const { source = from, sourceLayer } = this.places[from] ?? {};
    return { id, type, source, paint: looks()[id.replace("near-", "")], ...kind(id), ...(sourceLayer && { "source-layer": sourceLayer }) };
  }

  // Shows further land, and other land instead of what was shown.
  take(sources) {
    for (const [id, source] of Object.entries(sources)) {
      if (this.map.getSource(id)) {
        this.map.getSource(id).setData(source.data);
      } else {
        this.map.addSource(id, source);
        for (const one of LAYERS.filter(([, , from]) => from === id)) this.map.addLayer(this.layer(one), "areas");
      }
    }
  }

  paint() {
    const paint = looks();
    for (const { id } of this.map.getStyle()?.layers ?? []) {
      for (const [name, value] of Object.entries(paint[id.replace("near-", "")] ?? {})) {
        this.map.setPaintProperty(id, name, value);
      }
    }
  }

  // Asks for shapes again, of another state of the scene.
  renew(version, kinds = KINDS) {
    for (const kind of kinds) this.map.getSource(kind)?.setTiles?.([this.source.tilesAt(kind, version)]);
  }

  // Draws the shapes of the scene, or none of them.
  reveal(isShown) {
    const shapes = LAYERS.filter(([, , from]) => from in this.places);
    const set = () => shapes.forEach(([id]) => this.map.setLayoutProperty(id, "visibility", isShown ? "visible" : "none"));
    if (this.isReady) set();
    else this.map.once("style.load", set);
  }

  // Whether the map is so near that tiles show the scene.
  showsDetail() {
    return this.map.getZoom() >= this.detailZoom;
  }

  isDetailLoaded() {
    return KINDS.every((kind) => this.map.isSourceLoaded(kind));
  }

  // Sets which features of a kind are on, hidden and chosen; asks MapLibre only where that is new.
  show(kind, wanted) {
    if (!this.isReady) return;
    const known = this.states.get(kind);
    const layers = kind === "conflicts" ? ["conflicts", "first_contacts"] : [kind];
    for (const [id, { on = false, hidden = false, chosen = false }] of wanted) {
      const mark = (on ? 1 : 0) + (hidden ? 2 : 0) + (chosen ? 4 : 0);
      if ((known.get(id) ?? 0) !== mark) {
        known.set(id, mark);
        for (const layer of layers) this.map.setFeatureState({ ...this.places[layer], id }, { on, hidden, chosen });
      }
    }
  }

  // Where pixels are: of a place in units of the world (0 to 1, Web Mercator), for what is drawn above the map.
  frame() {
    const { map } = this;
    const size = 512 * 2 ** map.getZoom();
    const centre = map.getCenter();
    const { clientWidth: width, clientHeight: height } = map.getContainer();
    return {
      size, width, height,
      left: mercatorX(centre.lng) - width / 2 / size,
      top: mercatorY(centre.lat) - height / 2 / size,
      metresPerPixel: MERCATOR_M / size,
    };
  }

  // Goes to a box (degrees; east may be beyond 180), or to a place in it.
  goTo([west, south, east, north], padding) {
    this.map.fitBounds([[west, clamp(south)], [east, clamp(north)]], { padding, maxZoom: 15, duration: 600 });
  }

  // The conflicts at a pixel, those on top first.
  conflictsAt(point) {
    if (!this.showsDetail()) return this.overview.conflictsAt(point);
    const around = [[point.x - 4, point.y - 4], [point.x + 4, point.y + 4]];
    return this.map.queryRenderedFeatures(around, { layers: ["first-contacts", "conflicts"] })
      .filter(({ id }) => !((this.states.get("conflicts").get(id) ?? 0) & 2))
      .map(({ id }) => id);
  }
}

// The zoom from which a large scene is shown by tiles: not all that they then hold is in view.
function detailZoomOf([west, south, east, north], { clientWidth, clientHeight }) {
  const room = (length) => Math.max(1, length - 2 * FIT.padding) / 512;
  const [width, height] = [mercatorX(east) - mercatorX(west), mercatorY(clamp(south)) - mercatorY(clamp(north))];
  const fits = Math.log2(Math.min(room(clientWidth) / width, room(clientHeight) / height));
  return Math.min(MOST_TILED, Math.ceil(Math.max(0, Math.min(fits, FIT.maxZoom)) + FAR_ZOOMS));
}

// What is around a scene, null where that is large or reaches the edge of the map.
function nearOf([west, south, east, north]) {
  const around = [west - MARGIN_DEG, south - MARGIN_DEG, east + MARGIN_DEG, north + MARGIN_DEG];
  const isSmall = around[2] - around[0] < SMALL_DEG && around[3] - around[1] < SMALL_DEG;
  return isSmall && around[0] > -180 && around[2] < 180 && around[1] > -90 && around[3] < 90 ? around : null;
}

const clamp = (lat) => Math.min(85, Math.max(-85, lat));
