// Ticks of a time axis at steps of the calendar, in the zone that is chosen: seconds to hours, days, weeks, months and years.

import { instantAt, offsetAt } from "./display.js";
import { clock, day } from "./format.js";

const [MINUTE, HOUR, DAY] = [60, 3600, 86400];
const MONTH = 30.4 * DAY;
const YEAR = 365.25 * DAY;
const STEPS = [1, 2, 5, 10, 15, 30].flatMap((n) => [n, n * MINUTE]).concat([1, 2, 3, 6, 12].map((n) => n * HOUR), [1, 2, 7].map((n) => n * DAY))
  .sort((a, b) => a - b).map((s) => ({ s, unit: s < DAY ? "clock" : "day" }));
const LONG = [1, 3, 6].map((n) => ({ s: n * MONTH, unit: "month", n }))
  .concat([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].map((n) => ({ s: n * YEAR, unit: "year", n })));
const SHORT = 0.5; // names of months need this share of the room of a time
const MONDAY = 4 * DAY; // of the first week of 1970
const NAMES = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

const utc = (year, month) => {
  const date = new Date(0);
  date.setUTCFullYear(year, month, 1);
  return date.getTime() / 1000;
};

// Ticks between two instants, at most about so many: [{ t, text }].
export function ticks([from, to], most) {
  const wanted = (to - from) / Math.max(1, most);
  const step = [...STEPS, ...LONG].find(({ s, unit }) => s >= wanted * (unit === "month" ? SHORT : 1)) ?? LONG[LONG.length - 1];
  return step.unit === "month" || step.unit === "year" ? months(from, to, step) : even(from, to, step.s);
}

function even(from, to, step) {
  const first = step === 7 * DAY ? MONDAY : 0;
  const found = [];
  const ahead = offsetAt(from);
  for (let there = first + Math.ceil((from + ahead - first) / step) * step; ; there += step) {
    const t = instantAt(there);
    if (t > to) return found;
    if (t < from || t === found[found.length - 1]?.t) continue;
    const isDay = step >= DAY || (there % DAY === 0 && found.length > 0);
    found.push({ t, text: isDay ? day(t).split(" ").slice(0, 2).join(" ") : clock(t, step < MINUTE) });
  }
}

function months(from, to, { unit, n }) {
  const start = new Date((from + offsetAt(from)) * 1000);
  const found = [];
  let [year, month] = [start.getUTCFullYear(), start.getUTCMonth()];
  if (unit === "year") [year, month] = [Math.floor(year / n) * n, 0];
  else month -= month % n;
  for (;;) {
    const there = utc(year, month);
    const t = instantAt(there);
    if (!(t <= to)) return found;
    const date = new Date(there * 1000);
    const isYear = unit === "year" || date.getUTCMonth() === 0;
    const name = NAMES[date.getUTCMonth()];
    if (t >= from) found.push({ t, text: isYear ? `${date.getUTCFullYear()}` : found.length ? name : `${name} ${date.getUTCFullYear()}` });
    if (unit === "year") year += n;
    else month += n;
  }
}
