// What lists and the timeline call both objects of a pair: by their names, or else their keys, cut so that they stay two.

import { printable } from "./format.js";

// Both names; of two that are the same, with their keys.
export function namesOf({ a, b }, objects) {
  const keys = [a, b].map(printable);
  const names = [a, b].map((key, n) => printable(objects.get(key)?.name || "") || keys[n]);
  return names[0] === names[1] && keys[0] !== keys[1] ? names.map((name, n) => (name === keys[n] ? name : `${name} (${keys[n]})`)) : names;
}

// Whether one of both has a name that is not its key.
export const areNamed = (pair, objects) => [pair.a, pair.b].some((key) => { const name = objects.get(key)?.name; return Boolean(name) && name !== key; });

// A text, cut to a width: in its middle, as names of one kind differ at their ends, or else at its end. `widthOf(text)` measures.
export function fitted(widthOf, text, room, isAtEnd = false) {
  if (widthOf(text) <= room) return text;
  const signs = [...text]; // half of a surrogate pair is none
  const cut = (n) => (isAtEnd ? `${signs.slice(0, n).join("")}…`
    : `${signs.slice(0, Math.ceil(n / 2)).join("")}…${signs.slice(signs.length - Math.floor(n / 2)).join("")}`);
  let [low, high] = [0, signs.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (widthOf(cut(middle)) <= room) low = middle;
    else high = middle;
  }
  return cut(low);
}

// Two texts, each cut to its room, never to the same: then what both begin with goes.
export function fittedPair(widthOf, texts, rooms) {
  const cut = texts.map((text, n) => fitted(widthOf, text, rooms[n]));
  if (cut[0] !== cut[1] || texts[0] === texts[1]) return cut;
  const signs = texts.map((text) => [...text]);
  const same = signs[0].findIndex((sign, n) => sign !== signs[1][n]);
  const from = same < 0 ? signs[0].length : same;
  return signs.map((own, n) => fitted(widthOf, `…${own.slice(from).join("") || own.slice(-1)[0]}`, rooms[n], true));
}
