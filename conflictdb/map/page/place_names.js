// Names of countries and towns below what moves, where there is room.

import { writeNames } from "./labels.js";
import { colour, theme } from "./theme.js";
import { mercatorX, mercatorY } from "./world.js";

const CLOSEST = { country: 6, town: 14 }; // zooms up to which names are shown
const DOT_PX = 3;
const SMALLEST = 2 ** 9; // pixels of the world at zoom 0

export class PlaceNames {
  // `places()` brings [{ name, kind, lon, lat, zoom }].
  constructor(canvas, view, places) {
    Object.assign(this, { canvas, view, places: null, shown: [] });
    this.drawn = "";
    places().then((found) => {
      this.places = found.map((one) => ({ ...one, x: mercatorX(one.lon), y: mercatorY(one.lat) }));
      this.draw();
    }, () => null); // the map is the same without
    view.map.on("render", () => this.draw());
    theme.onChange(() => this.draw());
  }

  draw() {
    if (this.places === null) return;
    const frame = this.view.frame();
    const ratio = window.devicePixelRatio || 1;
    const wanted = JSON.stringify([frame, ratio, colour("sea")]);
    if (wanted === this.drawn) return; // only time has moved
    this.drawn = wanted;
    const { size, width, height, left, top } = frame;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const zoom = Math.log2(size / SMALLEST);
    const names = [];
    context.fillStyle = colour("ink-soft");
    for (const { name, kind, x, y, zoom: from } of this.places) {
      if (zoom < from - 0.5 || zoom > CLOSEST[kind]) continue;
      const down = (y - top) * size;
      if (down < 0 || down > height) continue;
      for (let across = (x - left - Math.floor(x - left)) * size; across < width; across += size) {
        const isTown = kind === "town";
        if (isTown) context.fillRect(across - DOT_PX / 2, down - DOT_PX / 2, DOT_PX, DOT_PX);
        names.push({ key: name, text: isTown ? name : name.toUpperCase(), ink: "ink-faint", x: across, y: down, reach: isTown ? 2 : -9 });
      }
    }
    this.shown = writeNames(context, names, [], frame);
  }
}
