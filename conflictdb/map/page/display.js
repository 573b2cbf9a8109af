// The units and the time zone of the page, which people choose and the address keeps: nautical miles, knots, degrees and minutes, or
// kilometres, metres a second and decimal degrees; UTC, or a zone of the IANA database.

// The zone of this browser.
export const here = () => Intl.DateTimeFormat().resolvedOptions().timeZone ?? "UTC";

export const display = { isNautical: true, zone: "UTC" };
const heard = new Set();
const QUARTER_S = 900; // clocks change at quarters of an hour
const MOST_KNOWN = 10_000;

let formatter = null; // null: UTC
let known = new Map(); // offsets, seconds, by the quarter

// Formats of a zone; null if there is none of that name.
function formatterOf(zone) {
  const fields = Object.fromEntries(["year", "month", "day", "hour", "minute", "second"].map((name) => [name, "numeric"]));
  try {
    return new Intl.DateTimeFormat("en-US", { timeZone: zone, hourCycle: "h23", era: "short", ...fields });
  } catch {
    return null;
  }
}

export const isZone = (zone) => zone === "UTC" || formatterOf(zone) !== null;

export function choose({ isNautical, zone }) {
  if (isNautical === display.isNautical && zone === display.zone) return;
  Object.assign(display, { isNautical, zone });
  formatter = zone === "UTC" ? null : formatterOf(zone);
  known = new Map();
  for (const listener of heard) listener();
}

export const onChange = (listener) => heard.add(listener);

// By how much clocks of the zone are ahead of UTC at an instant, seconds.
export function offsetAt(t) {
  if (formatter === null || !Number.isFinite(t)) return 0;
  const quarter = Math.floor(t / QUARTER_S);
  if (!known.has(quarter)) {
    if (known.size >= MOST_KNOWN) known.clear();
    const date = new Date(quarter * QUARTER_S * 1000);
    if (Number.isNaN(date.getTime())) return 0;
    const field = Object.fromEntries(formatter.formatToParts(date).map(({ type, value }) => [type, value]));
    const [year, month, day, hour, minute, second] = ["year", "month", "day", "hour", "minute", "second"].map((name) => Number(field[name]));
    const there = new Date(0);
    there.setUTCFullYear(field.era === "BC" ? 1 - year : year, month - 1, day);
    there.setUTCHours(hour, minute, second);
    known.set(quarter, there.getTime() / 1000 - quarter * QUARTER_S);
  }
  return known.get(quarter);
}

// The instant at which clocks of the zone show what those of UTC show at another instant.
export const instantAt = (there) => there - offsetAt(there - offsetAt(there));

// "UTC", or what it is there at an instant: "UTC+1", "UTC-3:30".
export function zoneAt(t) {
  const offset = offsetAt(t);
  if (offset === 0) return "UTC";
  const by = Math.abs(Math.round(offset / 60));
  return `UTC${offset < 0 ? "-" : "+"}${Math.floor(by / 60)}${by % 60 ? `:${String(by % 60).padStart(2, "0")}` : ""}`;
}
