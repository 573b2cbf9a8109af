// One conflict: both objects, when, where, how sure, and which stage decided.

import { sentenceOf } from "./card.js";
import { DistanceChart } from "./distance_chart.js";
import { element } from "./dom.js";
import { bound, capital, distance as far, duration, heights, metres, moment, period, place, printable, zone } from "./format.js";
import { MERCATOR_END } from "./model.js";
import { plan } from "./plan.js";

const MOST_PERIODS = 50;

const SAYS = {
  conflict: "Conflict", grazing: "Grazing: too close to call", unresolved: "Unresolved: not proven apart",
};

const fact = (name, hue, ...values) => (
  [element("dt", {}, element("bdi", { class: hue }, printable(name))), element("dd", {}, ...values)]);

export class Detail {
  // `on`: back(), goTo(t), whatIf(object), brief(object), acknowledge(conflict, reason or null)
  constructor(container, on) {
    this.container = container;
    this.on = on;
    this.chart = null;
    this.t = 0;
    this.settled = null;
  }

  // Shows an instant.
  mark(t) {
    this.t = t;
    this.chart?.mark(t);
  }

  // Shows how deep they overlap, and when: `distance` (pair_distance.js) brings it, or null.
  async showDistance(conflict, model, distance, sentence, place) {
    let found;
    try {
      found = await distance;
    } catch {
      return; // the sentence is without it
    }
    if (this.conflict !== conflict || !found) return;
    sentence.textContent = sentenceOf(conflict, model, found);
    this.chart = new DistanceChart(found, this.on.goTo);
    this.chart.mark(this.t);
    place.replaceChildren(this.chart.picture, element("figcaption", {}, "Distance over time; below 0, how deep they overlap."));
  }

  // Shows at once what the list knows; `pair` brings the rest (explanation and footprints). `settled` waits for all of it.
  show(...given) {
    this.settled = this.draw(...given);
  }

  async draw(conflict, model, pair, distance, mayAcknowledge) {
    this.conflict = conflict;
    this.chart = null;
    const card = element("p", { class: "card" }, sentenceOf(conflict, model, null));
    const chart = element("figure");
    const objects = [conflict.a, conflict.b].map((key) => model.objects.get(key));
    const figure = element("figure", { class: "plan-figure" });
    const why = element("div", { class: "why" });
    const stages = element("div");
    const heading = element("h2", { tabindex: "-1" },
      element("bdi", { class: "key-a" }, printable(conflict.a)), element("span", { class: "soft" }, " and "),
      element("bdi", { class: "key-b" }, printable(conflict.b)));
    this.container.replaceChildren(
      element("button", { type: "button", class: "plain back", click: this.on.back }, "All conflicts"),
      heading,
      element("p", { class: "verdict" },
        element("span", { class: `mark ${conflict.verdict}`, "aria-hidden": "true" }), SAYS[conflict.verdict]),
      card, this.periods(conflict),
      element("dl", {}, ...this.facts(conflict, objects)),
      this.acknowledgement(conflict, mayAcknowledge),
      // These come later: nothing that is there already may move under a finger.
      chart, why, figure, stages);
    heading.focus({ preventScroll: true });
    this.container.scrollTop = 0;
    const drawn = this.showDistance(conflict, model, distance, card, chart);
    let found;
    try {
      found = await pair;
    } catch (error) {
      why.replaceChildren(element("p", { class: "problem" }, `Why, and what is around, is not known: ${printable(error.message)}`));
      figure.remove();
      return;
    }
    await drawn;
    if (this.conflict !== conflict) return; // another one was chosen meanwhile
    const { explanation: said, footprints } = found;
    if (said) {
      why.replaceChildren(element("p", {}, sentence(said.why)));
      stages.replaceChildren(...this.stages(said));
    }
    if (conflict.lon !== null) {
      const shapes = [conflict.a, conflict.b].map((key) => footprints[key] ?? null);
      const t = Number.isFinite(conflict.start) ? conflict.start : model.span[0];
      figure.replaceChildren(plan(objects, shapes, [conflict.lon, conflict.lat], t),
        element("figcaption", {}, `At first contact, on the ground. ${place(conflict.lon, conflict.lat)}`,
          conflict.isBeyond ? `: beyond ${MERCATOR_END.toFixed(2)}°, where only the polar view shows it.` : ""));
    }
  }

  periods({ periods, error_s: error }) {
    const rows = periods.slice(0, MOST_PERIODS).map(([a, b]) => element("tr", {},
      element("td", {}, element("button", { type: "button", class: "link", click: () => this.on.goTo(Number.isFinite(a) ? a : b) },
        period(a, b, null))),
      element("td", { class: "number" }, duration(b - a))));
    return element("div", {},
      element("table", {}, element("caption", {}, `${periods.length > 1 ? `${periods.length} periods` : "Period"} (${zone(Number.isFinite(periods[0]?.[0]) ? periods[0][0] : periods[0]?.[1])})`),
        element("thead", { class: "unseen" }, element("tr", {}, element("th", {}, "From and to"), element("th", {}, "Length"))),
        element("tbody", {}, ...rows)),
      periods.length > MOST_PERIODS ? element("p", { class: "soft" }, `and ${periods.length - MOST_PERIODS} more`) : null,
      element("p", { class: "soft" }, `Each end is right to within ${bound(error, "s")}.`));
  }

  facts(conflict, objects) {
    const found = objects.flatMap((object, i) => {
      const key = [conflict.a, conflict.b][i];
      const hue = `key-${"ab"[i]}`;
      if (!object) return fact(key, hue, "is no more");
      return fact(key, hue, object.name ? element("bdi", {}, printable(object.name)) : null, object.name ? ", " : null,
        `${object.kind}, ${heights(object.floor, object.ceiling)}`,
        object.kind === "track" ? element("div", {}, element("button", {
          type: "button", class: "link", click: () => this.on.whatIf(object),
        }, `What if ${printable(key)} departs earlier or later?`)) : null,
        element("div", {}, element("button", { type: "button", class: "link", click: () => this.on.brief(object) }, `Brief of ${printable(key)}`)));
    });
    return conflict.is_current ? found
      : [...found, ...fact("State", null, "one of them has changed since: the region is that of the last detection, and hatched")];
  }

  acknowledgement(conflict, mayAcknowledge) {
    const { acknowledged_by: who, acknowledged_for: why } = conflict;
    const problem = element("p", { class: "problem", role: "alert" });
    const send = async (event, reason) => {
      event.preventDefault();
      problem.textContent = "";
      try {
        await this.on.acknowledge(conflict, reason);
      } catch (error) {
        problem.textContent = printable(error.message);
      }
    };
    if (who !== null) {
      const end = Date.parse(conflict.acknowledged_until ?? "") / 1000;
      const until = Number.isFinite(end) ? `, until ${moment(end)} ${zone(end)}` : "";
      return element("section", { class: "acknowledge" },
        element("p", {}, "Acknowledged by ", element("bdi", {}, printable(who)), `${until}: `, element("bdi", {}, printable(why))),
        mayAcknowledge ? element("button", { type: "button", click: (event) => send(event, null) }, "Take back") : null, problem);
    }
    if (!mayAcknowledge) return "";
    const reason = element("input", { id: "reason", name: "reason", required: true, maxlength: 2000, autocomplete: "off" });
    return element("form", { class: "acknowledge", submit: (event) => send(event, reason.value) },
      element("label", { for: "reason" }, "Acknowledge, because"),
      element("div", { class: "line" }, reason, element("button", { type: "submit" }, "Acknowledge")), problem);
  }

  stages(said) {
    if (!said.stages) return [];
    return [element("details", {},
      element("summary", {}, "How it was decided"),
      said.decided_by ? element("p", {}, `Decided by stage ${said.decided_by.stage}: ${said.decided_by.by}.`) : null,
      element("ol", {}, ...said.stages.map(({ asks, says, left, pairs }) => element("li", {},
        `${sentence(asks)} `, element("span", { class: "soft" }, says ?? `${left} of ${pairs} pairs of pieces`)))),
      said.closest ? element("p", {}, `Closest: ${far(said.closest.m)}, within ${bound(said.closest.error_m, "m")}`,
        said.closest.at ? `, at ${moment(Date.parse(said.closest.at) / 1000)} ${zone(Date.parse(said.closest.at) / 1000)}` : "", ".") : null,
      element("p", { class: "soft" }, `Run ${said.run?.run_id ?? "–"}, method ${said.run?.method ?? said.settings.method}, `,
        `tolerance ${metres(said.settings.tolerance_m)}, separation ${far(said.settings.separation_m)}.`))];
  }
}

const sentence = (text) => {
  const said = printable(capital(text));
  return /[.?!]$/.test(said) ? said : `${said}.`;
};
