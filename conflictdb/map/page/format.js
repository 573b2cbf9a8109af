// Instants (Unix seconds), lengths and places as people read them: in the units and the time zone that are chosen.

import { display, instantAt, offsetAt, zoneAt } from "./display.js";

const MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

const UNPRINTABLE = /[\p{C}\p{Zl}\p{Zp}]|(?! )\p{Zs}/gu;

// A text that somebody wrote, with every sign that is not printed, or turns the order of others, as its number (printable.py).
export const printable = (text) => text.replace(UNPRINTABLE, (sign) => {
  const number = sign.codePointAt(0);
  const [letter, digits] = number < 0x100 ? ["x", 2] : number < 0x10000 ? ["u", 4] : ["U", 8];
  return { "\n": "\\n", "\r": "\\r", "\t": "\\t" }[sign] ?? `\\${letter}${number.toString(16).padStart(digits, "0")}`;
});

const MOST_LABEL = 24; // characters of a label on a map

// What a map calls an object: its name, or else its key.
export function labelOf({ key, name }) {
  const text = printable(name || key);
  return shortened(text, MOST_LABEL);
}

// A text of at most so many characters; a surrogate pair is one.
export function shortened(text, most) {
  const signs = text.length > most ? [...text] : [];
  return signs.length > most ? `${signs.slice(0, most - 1).join("")}…` : text;
}

export const NMI_M = 1852;
// The error of a product is no part of a tenth.
const ROUNDING = 1e-6;
const ROUND = [1, 2, 5].flatMap((n) => Array.from({ length: 8 }, (_, e) => n * 10 ** e)).sort((a, b) => a - b);

const two = (n) => String(n).padStart(2, "0");

// A date whose fields of UTC are those of the zone.
function parts(t) {
  const date = new Date(Math.floor((t + offsetAt(t)) * 1000 + 0.5));
  return Number.isNaN(date.getTime()) ? null : date;
}

// "UTC", or what it is there: "UTC+1".
export const zone = (t) => (Number.isFinite(t) ? zoneAt(t) : "UTC");

export function day(t) {
  const date = parts(t);
  return date ? `${date.getUTCDate()} ${MONTHS[date.getUTCMonth()]} ${date.getUTCFullYear()}` : "";
}

export function clock(t, withSeconds = true) {
  const date = parts(t);
  if (!date) return "";
  const minutes = `${two(date.getUTCHours())}:${two(date.getUTCMinutes())}`;
  return withSeconds ? `${minutes}:${two(date.getUTCSeconds())}` : minutes;
}

// The instant of a text as people write it in their zone, or in UTC: 2026-06-01 09:30, or with seconds; null if it is none.
export function instantOf(text, isUtc = false) {
  const found = /^\s*(\d{4})-(\d\d)-(\d\d)[ T]+(\d\d?):(\d\d)(?::(\d\d))?\s*(Z|UTC)?\s*$/i.exec(text);
  if (!found) return null;
  const [year, month, date, hour, minute, second] = found.slice(1, 7).map((digits) => Number(digits ?? 0));
  const at = new Date(Date.UTC(year, month - 1, date, hour, minute, second));
  // Of a day or an hour that there is not, another one would come.
  const isThere = at.toISOString().startsWith(text.trim().slice(0, 10)) && hour < 24 && minute < 60 && second < 60;
  if (!isThere) return null;
  const t = at.getTime() / 1000;
  if (isUtc || found[7]) return t;
  const there = instantAt(t);
  return there + offsetAt(there) === t ? there : null; // clocks leave out an hour in spring
}

// An instant as fields have it: 2026-06-01 09:30:00.
export const written = (t) => new Date((t + offsetAt(t)) * 1000).toISOString().slice(0, 19).replace("T", " ");

// With the day where it is another one than that of the one before it.
export function moment(t, before = null) {
  if (t === -Infinity) return "since ever";
  if (t === Infinity) return "for ever";
  return before !== null && Number.isFinite(before) && day(before) === day(t) ? clock(t) : `${day(t)} ${clock(t)}`;
}

export function period(start, end, before = null) {
  if (start === -Infinity && end === Infinity) return "always";
  if (start === -Infinity) return `until ${moment(Math.ceil(end), before)}`;
  if (end === Infinity) return `from ${moment(start, before)} on`;
  return `${moment(start, before)} – ${moment(Math.ceil(end), start)}`; // outward, as in tables
}

export function duration(s) {
  if (!Number.isFinite(s)) return "";
  if (s < 60) return `${s < 10 ? s.toFixed(1) : Math.round(s)} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${two(Math.floor(s % 60))} s`;
  if (s < 172800) return `${Math.floor(s / 3600)} h ${two(Math.floor((s % 3600) / 60))} min`;
  return `${(s / 86400).toFixed(1)} days`;
}

// A length of time as a headline has it.
export function about(s) {
  if (s < 60) return `${Math.ceil(s)} s`;
  if (s < 3600) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  return `${Math.round(s / 86400)} days`;
}

// A bound, rounded up to two digits.
export function bound(value, unit) {
  if (value === null) return "not known";
  if (value === 0) return `0 ${unit}`;
  const [scale, name] = unit === "s" && value < 0.1 ? (value < 1e-4 ? [1e6, "µs"] : [1e3, "ms"]) : [1, unit];
  const scaled = value * scale;
  const digit = 10 ** (Math.floor(Math.log10(scaled)) - 1);
  return `${Number((Math.ceil(scaled / digit - 1e-9) * digit).toPrecision(2))} ${name}`;
}

export function metres(m, round = Math.round) {
  if (Math.abs(m) >= 10000) return `${tenths(m / 1000, round)} km`;
  if (m >= 100 || round !== Math.round) return `${round(m)} m`;
  return `${Number(m.toPrecision(3))} m`;
}

// A distance on the ground: nautical miles, below a tenth of one metres; or kilometres.
export function distance(m, round = Math.round) {
  if (!display.isNautical) return metres(m, round);
  if (m > (NMI_M / 10) * (1 - ROUNDING)) return `${tenths(m / NMI_M, round)} nmi`;
  return `${m >= 10 ? round(m) : tenths(m, round)} m`;
}

// Bounds stay true as they are rounded, by the rule of model/units.py.
export const leastDistance = (m) => distance(m, Math.floor);
export const mostDistance = (m) => distance(m, Math.ceil);

function tenths(value, round) {
  const error = round === Math.floor ? ROUNDING : round === Math.ceil ? -ROUNDING : 0;
  return (round(value * 10 + error) / 10).toFixed(1);
}

// A distance that people chose, as it is: in the larger unit if it is whole hundredths of it, else in metres.
export function givenDistance(m) {
  const [unit, name] = display.isNautical ? [NMI_M, "nmi"] : [1000, "km"];
  const hundredths = Math.round((100 * m) / unit);
  return hundredths > 0 && Math.abs(hundredths * unit - 100 * m) < 1e-6 * m ? `${hundredths / 100} ${name}` : `${m} m`;
}

// The longest bar of a round length of at most so many metres: metres, or tenths of a nautical mile.
export function barLength(mostM) {
  const unit = display.isNautical && mostM >= NMI_M / 10 ? NMI_M / 10 : 1;
  return unit * (ROUND.findLast((n) => n * unit <= mostM) ?? 1);
}

// A speed over the ground.
export const speed = (mps) => (display.isNautical ? `${((mps * 3600) / NMI_M).toFixed(1)} kn` : `${mps.toFixed(1)} m/s`);

export function heights(floor, ceiling) {
  if (floor === null && ceiling === null) return "all heights";
  if (floor === null) return `below ${ceiling} m`;
  if (ceiling === null) return `above ${floor} m`;
  return `${floor} to ${ceiling} m`;
}

export function place(lon, lat) {
  const turned = ((((lon + 180) % 360) + 360) % 360) - 180;
  const said = (degrees, width) => (display.isNautical ? degreesAndMinutes(Math.abs(degrees), width) : `${Math.abs(degrees).toFixed(4)}°`);
  return `${said(lat, 2)} ${lat < 0 ? "S" : "N"} ${said(turned, 3)} ${turned < 0 ? "W" : "E"}`;
}

// With commas between thousands; the formats of the browser take some hundredths of a second to load.
export const grouped = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, ",");

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export const counted = (n, word) => `${grouped(n)} ${word}${n === 1 ? "" : "s"}`;

// 57°54.3′, of degrees with so many digits.
function degreesAndMinutes(degrees, width) {
  const tenths = Math.round(degrees * 600);
  return `${String(Math.floor(tenths / 600)).padStart(width, "0")}°${((tenths % 600) / 10).toFixed(1).padStart(4, "0")}′`;
}
