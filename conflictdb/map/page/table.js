// The conflicts that the filter leaves as a table: columns as the command line has them, sorted by any of them, and as CSV.

import { joined, parsed } from "./csv_text.js";
import { element } from "./dom.js";
import { counted, printable, shortened } from "./format.js";

const MOST_ROWS = 500; // more are in the file
const MOST_TEXT = 60; // characters of a cell

// A cell as it is compared: a number, or a text; an empty one is last in either order.
const valueOf = (text, isNumber) => (text === "" ? null : isNumber ? Number(text) : text.toLowerCase());

// Saves a text as a file.
function save(text, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

export class Table {
  // `read()` brings the CSV of all conflicts; `on`: choose(conflict), shown(isShown).
  constructor(section, read, on) {
    Object.assign(this, { section, read, on });
    this.left = [];
    this.table = null; // (csv_text.js)
    this.sorted = null; // { column, isDown }
    this.version = null;
    this.asked = 0;
    this.heading = element("h2", { tabindex: "-1" }, "Conflicts");
    this.said = element("p", { class: "soft", role: "status" });
    this.save = element("button", { type: "button", click: () => this.export() }, "Save as CSV");
    this.body = element("div", { class: "table-body", tabindex: "0", role: "group", "aria-label": "Table of conflicts" });
    section.replaceChildren(
      element("header", {}, this.heading, this.save, element("button", { type: "button", class: "plain", "aria-label": "Close the table", click: () => this.show(false) }, "✕")),
      this.said, this.body);
  }

  get isShown() {
    return !this.section.hidden;
  }

  show(isShown) {
    if (isShown === this.isShown) return;
    this.section.hidden = !isShown;
    this.on.shown(isShown);
    if (!isShown) return;
    this.heading.focus({ preventScroll: true });
    this.draw();
  }

  // The conflicts that the filter leaves, of a state of the scene.
  take(left, version, name) {
    Object.assign(this, { left, name });
    if (version !== this.version) [this.version, this.table] = [version, null];
    if (this.isShown) this.draw();
  }

  async draw() {
    if (!this.left.length) {
      this.say("No conflict is left to show.");
      return;
    }
    if (this.table === null) {
      const asked = ++this.asked;
      this.say("Reading …");
      try {
        const table = parsed(await this.read());
        if (asked !== this.asked) return;
        this.table = table;
      } catch (error) {
        this.say(`Not known: ${printable(error.message)}.`);
        return;
      }
    }
    this.render();
  }

  say(text) {
    this.said.textContent = text;
    this.save.disabled = true;
    this.body.replaceChildren();
  }

  // Records of the conflicts that are left, in the order of the table.
  records() {
    const { header: { cells: names }, records } = this.table;
    const id = names.indexOf("conflict_id");
    const left = new Map(this.left.map((conflict) => [String(conflict.id), conflict]));
    const shown = records.filter(({ cells }) => left.has(cells[id])).map((record) => ({ ...record, conflict: left.get(record.cells[id]) }));
    if (this.sorted === null) return shown;
    const column = names.indexOf(this.sorted.column);
    const isNumber = shown.every(({ cells }) => cells[column] === "" || Number.isFinite(Number(cells[column])));
    const way = this.sorted.isDown ? -1 : 1;
    return shown.map((record) => [valueOf(record.cells[column], isNumber), record]).sort(([a], [b]) => (
      a === b ? 0 : a === null ? 1 : b === null ? -1 : a < b ? -way : way)).map(([, record]) => record);
  }

  sortBy(column) {
    const { sorted } = this;
    this.sorted = sorted?.column === column ? (sorted.isDown ? null : { column, isDown: true }) : { column, isDown: false };
    this.render();
    this.body.querySelector(`th[data-column="${column}"] button`)?.focus();
  }

  render() {
    const { header: { cells: names } } = this.table;
    const records = this.records();
    // Columns with a value, and which they are.
    const columns = names.map((name, n) => [name, n]).filter(([name, n]) => name !== "scene" && records.some(({ cells }) => cells[n] !== ""));
    const state = (name) => (this.sorted?.column === name ? (this.sorted.isDown ? "descending" : "ascending") : "none");
    const cell = (record, [name, n]) => {
      const text = printable(record.cells[n]);
      const short = shortened(text, MOST_TEXT);
      return element("td", { class: Number.isFinite(Number(text || NaN)) ? "number" : null },
        name === "a_key" ? element("button", { type: "button", class: "link", click: () => this.on.choose(record.conflict) }, short) : short);
    };
    this.body.replaceChildren(element("table", {},
      element("caption", { class: "unseen" }, "Conflicts, as the command line lists them"),
      element("thead", {}, element("tr", {}, ...columns.map(([name]) => element("th", { scope: "col", "aria-sort": state(name), "data-column": name },
        element("button", { type: "button", class: "plain", click: () => this.sortBy(name) }, name.replaceAll("_", " ")))))),
      element("tbody", {}, ...records.slice(0, MOST_ROWS).map((record) => element("tr", {}, ...columns.map((column) => cell(record, column)))))));
    const more = records.length > MOST_ROWS ? `; the first ${MOST_ROWS} are shown, all are in the file` : "";
    this.said.textContent = `${counted(records.length, "conflict")}${more}. Times are UTC.`;
    this.save.disabled = false;
  }

  // The columns and cells of `conflictdb conflicts --format csv`.
  export() {
    save(joined(this.table, this.records()), `${this.name.replace(/[^\p{L}\p{N}_-]+/gu, "-")}.csv`);
  }
}
