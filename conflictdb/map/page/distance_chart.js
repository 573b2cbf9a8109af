// The distance of a pair over time as a picture: below 0 they overlap, below the line of the separation they are too near.

import { drawn } from "./dom.js";
import { clock, distance } from "./format.js";

const [WIDTH, HEIGHT, FOOT] = [320, 110, 16];
const MOST_ABOVE = 2; // so many times the depth, or the separation, that is shown above

export class DistanceChart {
  // `goTo(t)` hears of a click.
  constructor({ samples, least, separationM }, goTo) {
    const [from, to] = [samples[0][0], samples[samples.length - 1][0]];
    const low = Math.min(0, least[1]);
    const top = Math.max(separationM, MOST_ABOVE * Math.max(separationM, -low, 1));
    this.x = (t) => (Math.min(1, Math.max(0, (t - from) / (to - from))) * WIDTH);
    const y = (m) => 6 + ((top - Math.min(top, m)) / (top - low)) * (HEIGHT - FOOT - 12);
    const line = samples.map(([t, m]) => `${this.x(t).toFixed(1)},${y(m).toFixed(1)}`);
    const rule = (m, name) => drawn("line", { x1: 0, x2: WIDTH, y1: y(m), y2: y(m), class: name });
    const text = (x, at, anchor, said) => drawn("text", { x, y: at, "text-anchor": anchor }, said);
    const limit = y(separationM);
    this.now = drawn("line", { y1: 0, y2: HEIGHT - FOOT, class: "chart-now" });
    this.picture = drawn("svg", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "img",
      "aria-label": `Distance over time: least ${least[1] < 0 ? `−${distance(-least[1])}` : distance(least[1])} at ${clock(least[0])}`,
      click: ({ offsetX }) => goTo(from + (offsetX / this.picture.clientWidth) * (to - from)),
    },
    drawn("defs", {}, drawn("clipPath", { id: "too-near" }, drawn("rect", { x: 0, y: limit, width: WIDTH, height: HEIGHT - limit }))),
    drawn("polygon", { points: [`0,${limit}`, ...line, `${WIDTH},${limit}`].join(" "), class: "chart-near", "clip-path": "url(#too-near)" }),
    rule(0, "chart-zero"), separationM > 0 ? rule(separationM, "chart-limit") : null,
    drawn("polyline", { points: line.join(" "), class: "chart-line" }),
    drawn("circle", { cx: this.x(least[0]), cy: y(least[1]), r: 3, class: "chart-least" }),
    this.now,
    text(0, HEIGHT - 3, "start", clock(from)), text(WIDTH, HEIGHT - 3, "end", clock(to)),
    text(2, y(0) - 3, "start", "0"), separationM > 0 ? text(2, limit - 3, "start", distance(separationM)) : null);
  }

  mark(t) {
    this.now.setAttribute("x1", this.x(t));
    this.now.setAttribute("x2", this.x(t));
  }
}
