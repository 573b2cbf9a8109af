// Where the page has its scene from when it is one file: conflictdb/map/html.py put it in, compressed.

import { byId } from "./dom.js";

const bytes = (text) => Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0)).buffer;

export async function unpacked(id) {
  return new Response(new Blob([bytes(byId(id).textContent)]).stream().pipeThrough(new DecompressionStream("gzip")));
}

export class EmbeddedSource {
  isLive = false;

  constructor() {
    this.content = unpacked("scene-data").then((text) => text.json());
  }

  async scene() {
    return (await this.content).scene;
  }

  async conflicts() {
    return bytes((await this.content).conflicts);
  }

  async depths() {
    return (await this.content).depths;
  }

  async areas() {
    return (await this.content).areas;
  }

  async tracks() {
    return bytes((await this.content).tracks);
  }

  async table() {
    return (await this.content).table;
  }

  async places() {
    return (await this.content).places;
  }

  async heights() {
    return (await this.content).heights;
  }

  // Of all objects.
  async owners() {
    return (await this.content).owners;
  }

  async shapes() {
    return (await this.content).shapes;
  }

  async landShapes() {
    const { land, near_land: near } = await this.content;
    return [...land.features, ...(near?.features ?? [])];
  }

  async pair(a, b) {
    const { pairs, shapes } = await this.content;
    const footprints = shapes.areas.features.filter(({ properties: { key } }) => key === a || key === b);
    return {
      explanation: pairs.find(([first, second]) => first === a && second === b)?.[2] ?? null,
      footprints: Object.fromEntries(footprints.map(({ properties, geometry }) => [properties.key, geometry])),
    };
  }

  async kernel() {
    return (await unpacked("kernel.wasm")).arrayBuffer();
  }

  // Pieces of all objects.
  async pieces() {
    return bytes((await this.content).pieces);
  }

  async piecesNear() {
    return this.pieces();
  }

  // Shapes as MapLibre takes them, each layer a source; and land: the coarser one, and the finer one of some places.
  async sources() {
    const { shapes, land, near_land: near } = await this.content;
    const geojson = (data) => ({ type: "geojson", data });
    return {
      sources: {
        ...Object.fromEntries(Object.entries(shapes).map(([layer, data]) => [layer, geojson(data)])),
        land: geojson(land),
        ...(near && { "near-land": geojson(near) }),
      },
      places: Object.fromEntries(Object.keys(shapes).map((layer) => [layer, { source: layer }])),
    };
  }
}
