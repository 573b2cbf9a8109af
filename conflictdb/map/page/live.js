// How ships keep their plans: conflicts that follow from their lateness, and their last positions.

import { byId, element } from "./dom.js";
import { clock, counted, grouped, leastDistance, moment } from "./format.js";

const AGAIN_MS = 10_000; // how often states are read again; alarms come at once
const NONE_MS = 60_000; // in a scene without positions
const MOST_ALARMS = 5; // rows; more would hide the list
const VERBS = { must: ["meets", "at"], may: ["may meet", "at"], now: ["is in conflict with", "since"] };

// The possible lateness in whole minutes, outward: "11 to 14 min late", "2 min early to 5 min late"; null: not known.
function latenessText({ late_from_s: from, late_to_s: to }) {
  if (from === null || to === null) return null;
  const [least, most] = [Math.floor(from / 60), Math.ceil(to / 60)];
  if (least >= 0) return `${range(least, most)} late`;
  if (most <= 0) return `${range(-most, -least)} early`;
  return `${-least} min early to ${most} min late`;
}

const range = (least, most) => (least === most ? `${most} min` : `${least} to ${most} min`);

// How a track keeps its plan: "11 to 14 min late", "off by 1.2 nmi", "silent, 2 min early to 5 min late", "on plan".
export function stateText(track) {
  const late = latenessText(track);
  if (track.state === "off") return track.off_m === null ? "off" : `off by ${leastDistance(track.off_m)}`;
  if (track.state === "late" || track.state === "early") return late ?? track.state;
  return track.state === "silent" && late !== null ? `silent, ${late}` : track.state;
}

// As the command line says it, with names: "Ferry 11 to 14 min late: meets Diving on a wreck at 09:11:02 (slack used up)".
function alarmText({ key, other_key: other, verdict, reason, first }, tracks, label, t) {
  const named = (one) => {
    const track = tracks.get(one);
    return track && track.state !== "on plan" ? `${label(one)} ${stateText(track)}` : label(one);
  };
  if (other === null) return `${named(key)}: may meet anything near (${reason})`;
  const [verb, when] = VERBS[verdict];
  return `${named(key)}: ${verb} ${named(other)}${first === null ? "" : ` ${when} ${moment(first, t)}`} (${reason ?? "slack used up"})`;
}

export class Live {
  // `on`: changed(tracks by key), alarm(alarm), newest(Unix seconds), label(key): how people call an object
  constructor(container, source, on) {
    Object.assign(this, { container, source, on, tracks: new Map(), alarms: [], timer: null, asked: 0, isWhole: false });
    document.addEventListener("visibilitychange", () => { if (!document.hidden && this.timer !== null) this.read(); });
  }

  // Reads all again, now and from time to time.
  async read() {
    const asked = ++this.asked;
    clearTimeout(this.timer);
    try {
      const { tracks, alarms } = await this.source.live();
      if (asked !== this.asked) return;
      this.tracks = new Map(tracks.map((one) => [one.key, one]));
      this.alarms = alarms;
      this.draw();
      this.on.changed(this.tracks);
    } catch {
      // The page says whether the server answers; what is shown says how old it is.
    }
    if (asked === this.asked) this.timer = setTimeout(() => { if (!document.hidden) this.read(); }, this.tracks.size ? AGAIN_MS : NONE_MS);
  }

  // Shows nothing more of a scene that may no longer be seen.
  forget() {
    this.asked += 1;
    clearTimeout(this.timer);
    this.timer = null;
    this.tracks = new Map();
    this.alarms = [];
    this.draw();
    this.on.changed(this.tracks);
  }

  draw() {
    const { container, tracks, alarms } = this;
    container.hidden = tracks.size === 0;
    if (container.hidden) {
      container.replaceChildren();
      byId("alarm").textContent = "";
      return;
    }
    const newest = [...tracks.values()].reduce((last, { t }) => Math.max(last, t), -Infinity);
    const counts = new Map();
    for (const { state } of tracks.values()) counts.set(state, (counts.get(state) ?? 0) + 1);
    const shown = this.isWhole ? alarms : alarms.slice(0, MOST_ALARMS);
    const more = alarms.length - shown.length;
    const hadFocus = container.contains(document.activeElement) ? document.activeElement.dataset.alarm : undefined;
    container.replaceChildren(
      element("p", { class: "soft" }, `${counted(tracks.size, "position")}, `, element("button", { type: "button", class: "link", title: "Show this instant", click: () => this.on.newest(newest) }, `the last at ${clock(newest)}`),
        `: ${[...counts].map(([state, n]) => `${grouped(n)} ${state}`).join(", ")}`),
      element("ul", { "aria-label": "Conflicts that follow" }, ...shown.map((one) => element("li", {},
        element("button", { type: "button", class: "link", "data-alarm": one.alarm_id, click: () => this.on.alarm(one) }, alarmText(one, tracks, this.on.label, newest)),
        one.acknowledged_by === null ? null : element("span", { class: "tag" }, "acknowledged")))),
      more > 0 ? element("button", { type: "button", class: "plain", click: () => { this.isWhole = true; this.draw(); } }, `${grouped(more)} more`) : "");
    const text = alarms.length ? alarmText(alarms[0], tracks, this.on.label, newest) : "";
    if (byId("alarm").textContent !== text) byId("alarm").textContent = text;
    if (hadFocus !== undefined) container.querySelector(`[data-alarm="${hadFocus}"]`)?.focus();
  }
}
