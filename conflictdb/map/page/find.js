// Finds objects by key or name, places by name, and positions, while somebody writes.

import { element } from "./dom.js";
import { place as written, printable } from "./format.js";

const [MOST_OBJECTS, MOST_PLACES] = [5, 4];
const POSITION = /^\s*(-?\d+(?:\.\d+)?)\s*°?\s*([ns])?[\s,;]+(-?\d+(?:\.\d+)?)\s*°?\s*([ew])?\s*$/i;
const POSITION_ZOOM = 10;

const plain = (text) => text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();

// Latitude, then longitude: 57.9 8.6, or 57.9 N 8.6 E. Returns [lon, lat], or null.
export function positionOf(text) {
  const found = POSITION.exec(text);
  if (!found) return null;
  const [lat, lon] = [Number(found[1]) * (/s/i.test(found[2] ?? "") ? -1 : 1), Number(found[3]) * (/w/i.test(found[4] ?? "") ? -1 : 1)];
  return Math.abs(lat) <= 90 && Math.abs(lon) <= 180 ? [lon, lat] : null;
}

// Those whose texts begin with or contain a text, the former first; at most so many.
function matching(all, textsOf, wanted, most) {
  const ranked = [[], []];
  for (const one of all) {
    const texts = textsOf(one).map(plain);
    if (texts.some((text) => text.startsWith(wanted))) ranked[0].push(one);
    else if (texts.some((text) => text.includes(wanted))) ranked[1].push(one);
    if (ranked[0].length >= most) break;
  }
  return ranked.flat().slice(0, most);
}

export class Finder {
  // Of an input and a list below it. `places()` brings [{ name, lon, lat, zoom }]; `on`: object(object), place({ lon, lat, zoom }).
  constructor(input, list, places, on) {
    Object.assign(this, { input, list, places, on });
    this.objects = [];
    this.options = []; // what each does
    this.active = -1;
    this.asked = 0;
    input.addEventListener("input", () => this.find());
    input.addEventListener("keydown", (event) => this.pressed(event));
    list.addEventListener("pointerdown", (event) => event.preventDefault()); // the input keeps the focus
    list.addEventListener("click", ({ target }) => this.options[[...list.querySelectorAll("[role=option]")].indexOf(target.closest("[role=option]"))]?.());
  }

  take(objects) {
    this.objects = objects;
  }

  hide() {
    this.asked += 1;
    this.offer([]);
  }

  async find() {
    const text = this.input.value.trim();
    const asked = ++this.asked;
    if (text === "") {
      this.offer([]);
      return;
    }
    const wanted = plain(text);
    const objects = matching(this.objects, ({ key, name }) => [key, printable(key), name ?? ""], wanted, MOST_OBJECTS);
    const position = positionOf(text);
    const offer = (places) => this.offer([
      ...objects.map((object) => ({ title: printable(object.key), text: [object.name ? printable(object.name) : null, object.kind].filter(Boolean).join(", "), does: () => this.on.object(object) })),
      ...(position ? [{ title: written(...position), text: "position", does: () => this.on.place({ lon: position[0], lat: position[1], zoom: POSITION_ZOOM }) }] : []),
      ...places.map((one) => ({ title: one.name, text: one.kind, does: () => this.on.place(one) })),
    ]);
    offer([]);
    let places;
    try {
      places = await this.places();
    } catch {
      return; // objects are known without
    }
    if (asked === this.asked) offer(matching(places, ({ name }) => [name], wanted, MOST_PLACES));
  }

  offer(found) {
    this.active = -1;
    this.options = found.map(({ does }) => () => { this.hide(); does(); });
    this.list.hidden = found.length === 0;
    this.input.setAttribute("aria-expanded", found.length > 0);
    this.input.removeAttribute("aria-activedescendant");
    this.list.replaceChildren(...found.map(({ title, text }, n) => element("li", { id: `found-${n}`, role: "option", "aria-selected": "false" },
      element("bdi", {}, title), " ", element("span", { class: "soft" }, text))));
  }

  pressed(event) {
    const count = this.options.length;
    if (count === 0) return;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      const from = this.active < 0 && event.key === "ArrowUp" ? 0 : this.active;
      this.active = (from + (event.key === "ArrowDown" ? 1 : -1) + count) % count;
      [...this.list.children].forEach((one, n) => one.setAttribute("aria-selected", n === this.active));
      this.input.setAttribute("aria-activedescendant", `found-${this.active}`);
      this.list.children[this.active].scrollIntoView({ block: "nearest" });
    } else if (event.key === "Enter") {
      event.preventDefault();
      this.options[Math.max(0, this.active)]();
    } else if (event.key === "Escape") {
      event.preventDefault();
      event.stopPropagation();
      this.hide();
    }
  }
}
