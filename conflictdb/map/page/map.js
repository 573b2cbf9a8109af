// The map: land, areas, paths and conflict regions. What is on, chosen or hidden is a state of a feature, so that moving
// in time asks for no tile again.

import * as maplibregl from "../vendor/maplibre-gl.mjs";
import { display } from "./display.js";
import { Overview } from "./overview.js";
import { seenAround } from "./source.js";
import { colour, theme } from "./theme.js";
import { mercatorX, mercatorY, shorter } from "./world.js";

maplibregl.prewarm(); // its threads load while the scene does

const KEY_PX = 10; // by which an arrow key moves a waypoint

const state = (name) => ["boolean", ["feature-state", name], false];
// Hidden: nothing; else what holds for a feature that is chosen, dimmed since others are, on at the time that is shown, or
// none of these.
const byState = (chosen, on, off, dim) => (
  ["case", state("hidden"), 0, state("chosen"), chosen, state("dim"), dim, state("on"), on, off]);
// The objects of the pair that is chosen have hues of their own.
const hue = () => ["case", state("a"), colour("a"), state("b"), colour("b"), colour("object")];

// What each layer looks like in the colours of the theme.
const looks = () => ({
  sea: { "background-color": colour("sea") },
  land: { "fill-color": colour("land"), "fill-antialias": false },
  coast: { "line-color": colour("coast"), "line-width": 0.8 },
  areas: { "fill-color": hue(), "fill-opacity": byState(0.2, 0.14, 0.03, 0.02) },
  "areas-edge": {
    "line-color": hue(), "line-width": ["case", state("chosen"), 2.5, 1],
    "line-opacity": byState(1, 0.75, 0.25, 0.15),
  },
  tracks: {
    "line-color": hue(), "line-width": ["case", state("chosen"), 2.5, 1],
    "line-opacity": byState(1, 0.4, 0.12, 0.08),
  },
  conflicts: { "fill-color": colour("conflict"), "fill-opacity": byState(0.25, 0.45, 0.1, 0.03) },
  "conflicts-edge": {
    "line-color": colour("conflict"), "line-width": ["case", state("chosen"), 2.5, 1.2],
    "line-opacity": byState(1, 0.95, 0.35, 0.12),
  },
  // Of objects that changed since: what is shown is not what would be found now.
  "stale-conflicts": { "fill-pattern": "stale", "fill-opacity": byState(0.9, 0.7, 0.35, 0.1) },
  "stale-conflicts-edge": {
    "line-color": colour("conflict"), "line-width": ["case", state("chosen"), 2, 1], "line-dasharray": [3, 2],
    "line-opacity": byState(0.9, 0.7, 0.35, 0.12),
  },
  "first-contacts": {
    "circle-color": colour("conflict"), "circle-radius": ["case", state("chosen"), 5, 2.5],
    "circle-opacity": byState(1, 0.9, 0.4, 0.15), "circle-stroke-color": colour("paper"),
    "circle-stroke-width": ["case", state("hidden"), 0, state("dim"), 0, 1],
  },
  "stale-first-contacts": {
    "circle-color": colour("paper"), "circle-radius": ["case", state("chosen"), 4, 2],
    "circle-opacity": byState(1, 0.9, 0.4, 0.15), "circle-stroke-color": colour("conflict"),
    "circle-stroke-width": ["case", state("hidden"), 0, state("dim"), 0.5, 1],
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
  ["stale-conflicts", "fill", "conflicts"],
  ["stale-conflicts-edge", "line", "conflicts"],
  ["first-contacts", "circle", "first_contacts"],
  ["stale-first-contacts", "circle", "first_contacts"],
];

const CONFLICT_LAYERS = ["first-contacts", "stale-first-contacts", "conflicts", "stale-conflicts"];
const FLAGS = ["on", "hidden", "chosen", "dim", "a", "b"];
const HIDDEN = 1 << FLAGS.indexOf("hidden");
const HATCH_PX = 8;

// Hatching of regions that are not current, as an image.
function hatch() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = HATCH_PX;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.strokeStyle = colour("conflict");
  context.lineWidth = 1.5;
  context.beginPath();
  for (const from of [-HATCH_PX, 0, HATCH_PX]) { // each line enters where the one of the next tile leaves
    context.moveTo(from - 1, HATCH_PX + 1);
    context.lineTo(from + HATCH_PX + 1, -1);
  }
  context.stroke();
  return context.getImageData(0, 0, HATCH_PX, HATCH_PX);
}

const MERCATOR_M = 2 * Math.PI * 6378137;
const SMALL_DEG = 30; // around a scene that is smaller than this, with its margin, land is the finer one
const MARGIN_DEG = 5;
const MOST_TILED = 16; // the zoom of the finest tiles
const FIT = { padding: 48, maxZoom: 12 };
const LEGEND_PX = 46; // below the legend, and a little above
const FAR_ZOOMS = 3; // up to so many zooms beyond that which shows all of a large scene, tiles would hold too much

export class MapView {
  // Shows a scene in a container: box is [west, south, east, north]; a large scene has an overview.
  static async open(container, source, box, version, isLarge) {
    const detailZoom = isLarge ? detailZoomOf(box, document.getElementById(container)) : 0;
    const near = nearOf(box);
    const view = new MapView(container, source, box, detailZoom, await source.sources(version, near, detailZoom));
    if (near && source.landAround) view.loaded.then(() => view.takeLand(near));
    return view;
  }

  // Tiles are shown from detailZoom on: below, `overview` shows the scene, which is null where that is 0.
  constructor(container, source, box, detailZoom, { sources, places }) {
    this.source = source;
    this.detailZoom = detailZoom;
    this.places = places;
    this.handles = []; // markers
    this.states = new Map(KINDS.map((kind) => [kind, new Map()]));
    this.map = new maplibregl.Map({
      container,
      style: this.style(sources),
      bounds: [[box[0], Math.max(box[1], -85)], [box[2], Math.min(box[3], 85)]],
      fitBoundsOptions: { ...FIT, padding: roomAround(document.getElementById(container)) },
      dragRotate: false,
      pitchWithRotate: false,
      touchPitch: false,
      maxPitch: 0,
      maxZoom: 19,
      attributionControl: false,
      locale: { "ScaleControl.NauticalMiles": "nmi" },
      fadeDuration: 0,
      refreshExpiredTiles: false,
    });
    this.map.touchZoomRotate.disableRotation();
    this.map.keyboard.disableRotation();
    this.map.addControl(new maplibregl.NavigationControl({ showCompass: false }), "top-right");
    this.scale = new maplibregl.ScaleControl({ maxWidth: 140 });
    this.map.addControl(this.scale, "bottom-left");
    this.showUnits();
    this.map.getCanvas().setAttribute("aria-label", "Map");
    theme.onChange(() => this.paint());
    this.isReady = false; // for states of features
    // To measure the container takes a layout of the page, in each frame.
    const element = this.map.getContainer();
    const size = () => { this.size = [element.clientWidth, element.clientHeight]; };
    size();
    this.map.on("resize", size);
    this.map.once("style.load", () => {
      this.isReady = true;
      this.map.addImage("stale", hatch());
    });
    this.map.on("render", () => this.measure());
    this.overview = detailZoom > 0
      ? new Overview(document.getElementById("overview"), this, () => !this.showsDetail() || !this.isDetailLoaded()) : null;
    this.loaded = new Promise((resolve) => this.map.once("load", resolve));
  }

  style(sources) {
    const layers = LAYERS.filter(([, , from]) => from in sources || from in this.places).map((one) => this.layer(one));
    return { version: 8, sources, transition: { duration: 0, delay: 0 }, layers: [{ id: "sea", type: "background", paint: looks().sea }, ...layers] };
  }

  layer([id, type, from]) {
    const kind = (id) => (/^(near-)?(land|coast)$/.test(id) ? { filter: ["==", ["get", "kind"], id.replace("near-", "")] }
      : /conflicts|contacts/.test(id) && { filter: ["==", ["get", "is_current"], !id.startsWith("stale-")] });
    const { source = from, sourceLayer } = this.places[from] ?? {};
    return { id, type, source, paint: looks()[id.replace("near-", "")], ...kind(id), ...(sourceLayer && { "source-layer": sourceLayer }) };
  }

  // Shows the finer land around a scene, and the rest of the world once the map reaches beyond the land of the first view.
  takeLand(near) {
    const [west, south, east, north] = seenAround(near);
    const reach = () => {
      const shown = this.map.getBounds();
      if (shown.getWest() >= west && shown.getSouth() >= south && shown.getEast() <= east && shown.getNorth() <= north) return;
      this.map.off("move", reach);
      this.take(this.source.landBeyond(near));
    };
    this.take(this.source.landAround(near));
    this.map.on("move", reach);
    reach();
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
    if (this.map.hasImage("stale")) this.map.updateImage("stale", hatch());
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

  // The scale in the units that are chosen.
  showUnits() {
    this.scale.setUnit(display.isNautical ? "nautical" : "metric");
    this.measured = null;
    this.map.triggerRepaint();
  }

  // Whether places (degrees) are all in view.
  holds(places) {
    const bounds = this.map.getBounds();
    const middle = this.map.getCenter().lng;
    return places.every(([lon, lat]) => bounds.contains([middle + shorter(lon - middle), lat]));
  }

  // Resolves when all that is in view is drawn.
  idle() {
    const reached = new Promise((resolve) => this.map.once("idle", resolve));
    this.map.triggerRepaint();
    return reached;
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
    for (const [id, flags] of wanted) {
      const mark = FLAGS.reduce((sum, flag, n) => sum + (flags[flag] ? 1 << n : 0), 0);
      if ((known.get(id) ?? 0) !== mark) {
        known.set(id, mark);
        const states = Object.fromEntries(FLAGS.map((flag) => [flag, Boolean(flags[flag])]));
        for (const layer of layers) this.map.setFeatureState({ ...this.places[layer], id }, states);
      }
    }
  }

  // Says the shape of the map and the width of its scale to style.css, which prints all canvases as one picture.
  measure() {
    const [width, height] = this.size;
    const measured = `${width} ${height} ${this.map.getZoom()} ${this.map.getCenter().lat}`; // only time has moved
    if (measured === this.measured || matchMedia("print").matches) return;
    this.measured = measured;
    const scale = this.map.getContainer().querySelector(".maplibregl-ctrl-scale");
    const { style } = this.map.getContainer().parentElement;
    style.setProperty("--map-shape", width / height);
    style.setProperty("--scale-share", scale ? scale.getBoundingClientRect().width / width : 0);
  }

  // Where pixels are: of a place in units of the world (0 to 1, Web Mercator), for what is drawn above the map.
  frame() {
    const { map } = this;
    const size = 512 * 2 ** map.getZoom();
    const centre = map.getCenter();
    const [width, height] = this.size;
    return {
      size, width, height,
      left: mercatorX(centre.lng) - width / 2 / size,
      top: mercatorY(centre.lat) - height / 2 / size,
      metresPerPixel: MERCATOR_M / size,
    };
  }

  // Goes to a box (degrees; east may be beyond 180), or to a place in it.
  goTo([west, south, east, north], padding, maxZoom = 15) {
    this.map.fitBounds([[west, clamp(south)], [east, clamp(north)]], { padding, maxZoom, duration: 600 });
  }

  // Shows handles { name, lon, lat } (degrees) that can be dragged, or moved by the arrow keys; `onMove(n, lon, lat)` hears of it. null:
  // none. Handles that are there stay, as one of them may be dragged, or have the focus.
  showHandles(handles, onMove = null, hue = "a") {
    this.onHandle = onMove;
    const wanted = handles ?? [];
    while (this.handles.length > wanted.length) this.handles.pop().remove();
    wanted.forEach(({ name, lon, lat }, n) => {
      this.handles[n] ??= this.handle(n, [lon, lat]);
      const handle = this.handles[n].setLngLat([lon, lat]).getElement();
      handle.setAttribute("aria-label", name);
      handle.classList.toggle("of-b", hue === "b");
    });
  }

  handle(n, place) {
    const handle = document.createElement("button");
    handle.type = "button";
    handle.className = "handle";
    const marker = new maplibregl.Marker({ element: handle, draggable: true }).setLngLat(place).addTo(this.map);
    const moved = () => {
      const { lng, lat } = marker.getLngLat();
      this.onHandle(n, lng, lat);
    };
    marker.on("drag", moved);
    handle.addEventListener("click", (event) => event.stopPropagation());
    handle.addEventListener("keydown", (event) => {
      const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [0, 0];
      if (x === 0 && y === 0) return;
      event.preventDefault();
      event.stopPropagation();
      const at = this.map.project(marker.getLngLat());
      marker.setLngLat(this.map.unproject([at.x + KEY_PX * x, at.y + KEY_PX * y]));
      moved();
    });
    return marker;
  }

  // The middle and the zoom: longitude, latitude, zoom; and goes there.
  place() {
    const { lng, lat } = this.map.getCenter();
    return [lng.toFixed(5), lat.toFixed(5), this.map.getZoom().toFixed(2)].map(Number);
  }

  jumpTo([lon, lat, zoom]) {
    this.map.stop().jumpTo({ center: [lon, clamp(lat)], zoom });
  }

  // The conflicts at a pixel, those on top first.
  conflictsAt(point) {
    if (!this.showsDetail()) return this.overview.conflictsAt(point);
    const around = [[point.x - 4, point.y - 4], [point.x + 4, point.y + 4]];
    return this.map.queryRenderedFeatures(around, { layers: CONFLICT_LAYERS })
      .filter(({ id }) => !((this.states.get("conflicts").get(id) ?? 0) & HIDDEN))
      .map(({ id }) => id);
  }
}

// Room around the whole scene, pixels: below, the legend hides none of it.
function roomAround({ clientHeight }) {
  const { padding } = FIT;
  const legend = LEGEND_PX + document.getElementById("legend").offsetHeight;
  return { top: padding, left: padding, right: padding, bottom: Math.max(padding, Math.min(legend, clientHeight / 4)) };
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
