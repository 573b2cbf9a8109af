// What changed in a scene since it was opened, or since that was dismissed: objects, and conflicts that came, went or moved.

import { counted, printable } from "./format.js";

const UNKNOWN = "Conflicts changed"; // though no object did
const MOVED_S = 1; // of the same pair: first or last contact at another second

const pairOf = ({ a, b }) => JSON.stringify([a, b]);
const byPair = (conflicts) => new Map(conflicts.map((conflict) => [pairOf(conflict), conflict]));
const differ = (one, other) => (
  one.verdict !== other.verdict || Math.abs(one.start - other.start) > MOVED_S || Math.abs(one.end - other.end) > MOVED_S);

// How an object differs from itself before: null where it does not.
function verbOf(before, now) {
  if (!before) return "is new";
  if (!now) return "is gone";
  const points = [before, now].map(({ motion }) => motion?.points ?? []);
  const isSame = points[0].length === points[1].length
    && points[0].every(({ lon, lat, t }, i) => lon === points[1][i].lon && lat === points[1][i].lat && t === points[1][i].t);
  if (!isSame) return "moved";
  const rest = [before, now].map(({ floor, ceiling, start, end, box, inside, motion }) => (
    JSON.stringify([floor, ceiling, start, end, box, inside, motion?.outline, motion?.outlines, motion?.grow])));
  return rest[0] === rest[1] ? null : "changed";
}

// Conflicts of two states { objects, conflicts, label } of a scene that differ, each with `since`: "new", "gone" or "moved"; and a
// sentence, null where there are none and nobody asked for it (label).
export function changesOf(before, now) {
  const [old, known] = [byPair(before.conflicts), byPair(now.conflicts)];
  const conflicts = [];
  for (const [pair, conflict] of known) {
    const same = old.get(pair);
    if (!same) conflicts.push({ ...conflict, since: "new" });
    else if (differ(same, conflict)) conflicts.push({ ...conflict, since: "moved", was: { start: same.start, end: same.end } });
  }
  for (const [pair, conflict] of old) if (!known.has(pair)) conflicts.push({ ...conflict, since: "gone", change: "gone" });
  const label = before.label ? `${before.label}: ` : "";
  if (!conflicts.length) return { conflicts, text: label ? `${label}the same conflicts` : null };
  conflicts.sort((one, other) => one.start - other.start || one.id - other.id);
  const count = (since) => conflicts.filter((one) => one.since === since).length;
  const moved = count("moved") ? `, ${count("moved")} at another time` : "";
  const what = whatOf(before.objects, now.objects);
  const said = label ? `${label}${what === UNKNOWN ? "" : `${what}, `}` : `${what}: `;
  return { conflicts, text: `${said}${count("new")} new, ${count("gone")} gone${moved}` };
}

function whatOf(before, now) {
  const verbs = [...new Set([...before.keys(), ...now.keys()])].flatMap((key) => {
    const verb = before.get(key) === now.get(key) ? null : verbOf(before.get(key), now.get(key));
    return verb ? [[key, verb]] : [];
  });
  if (verbs.length === 0) return UNKNOWN;
  const [[key, verb]] = verbs;
  return verbs.length === 1 ? `${printable(key)} ${verb}` : `${counted(verbs.length, "object")} changed`;
}
