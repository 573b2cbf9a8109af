// One sentence on a conflict: what, when, how long, how sure, where, how deep and when most, and at which heights.

import { bound, clock, distance as far, duration, heights, metres, period, place, zone } from "./format.js";
import { missingText } from "./missing.js";
import { lasting } from "./model.js";

const VERBS = { conflict: "overlap", grazing: "touch, or nearly", unresolved: "may overlap" };
const NEAR_VERBS = { conflict: "are", grazing: "are just about", unresolved: "may be" };

function what({ verdict }, { separation_m: separation, time_separation_s: apart }) {
  if (apart > 0) return `${verdict === "conflict" ? "use" : "may use"} one place within ${duration(apart)}`;
  return separation > 0 ? `${NEAR_VERBS[verdict]} within ${far(separation)} of each other` : VERBS[verdict];
}

function when(conflict) {
  const { periods, start, end } = conflict;
  const lasts = lasting(conflict);
  const count = periods.length > 1 ? ` in ${periods.length} periods` : "";
  const long = Number.isFinite(lasts) ? ` for ${duration(lasts)}${count}` : count;
  return `${long}, ${period(start, end, null)} ${zone(start)}`;
}

// By the chart, or else as the list knows it, of the pair's own separation.
function deep(conflict, distance, { separation_m: separation }) {
  const { missing, deepest } = conflict;
  const most = missing === null ? "" : `, ${missingText(conflict)}${deepest === null ? "" : ` at ${clock(deepest)}`}`;
  if (!distance) return most;
  const { least: [t, m, error], isOfParts } = distance;
  const at = `at ${clock(t)}${Number.isFinite(error) ? ` (within ${bound(error, "m")})` : ""}`;
  if (m >= 0 && separation === 0) return "";
  if (m >= 0) return `, nearest ${far(m)} ${at}${missing === null ? "" : `, ${missingText(conflict)}`}`;
  return most || `, overlapping by ${isOfParts ? "at least " : ""}${far(-m)} ${at}`;
}

function high(conflict, model) {
  const [floor, ceiling] = model.heightsOf(conflict);
  const vertical = model.scene.vertical_separation_m;
  if (floor >= ceiling) return vertical > 0 ? `, with less than ${metres(vertical)} between their heights` : "";
  const said = heights(Number.isFinite(floor) ? floor : null, Number.isFinite(ceiling) ? ceiling : null);
  return said === "all heights" ? `, at ${said}` : `, at heights ${said}`;
}

// Of a conflict of a model; `distance` of the pair (pair_distance.js), or null.
export function sentenceOf(conflict, model, distance) {
  const where = conflict.lon === null ? "" : `, first at ${place(conflict.lon, conflict.lat)}`;
  return `They ${what(conflict, model.scene)}${when(conflict)}${where}${deep(conflict, distance, model.scene)}${high(conflict, model)}.`;
}
