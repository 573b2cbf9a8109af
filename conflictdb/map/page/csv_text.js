// Records of a CSV text (RFC 4180) with a header: their cells, and the text of each, so that a file of some of them is what the
// command line writes.

// Returns { header: { cells, text }, records: [{ cells, text }, …] }.
export function parsed(csv) {
  const records = [];
  let [cells, at, start] = [[], 0, 0];
  const end = (length) => {
    records.push({ cells, text: csv.slice(start, at) });
    at += length;
    [cells, start] = [[], at];
  };
  while (at < csv.length) {
    let cell = "";
    if (csv[at] === '"') {
      for (at += 1; at < csv.length; at += 1) {
        if (csv[at] === '"' && csv[at + 1] !== '"') break;
        if (csv[at] === '"') at += 1;
        cell += csv[at];
      }
      at += 1;
    } else {
      const from = at;
      while (at < csv.length && csv[at] !== "," && csv[at] !== "\n" && csv[at] !== "\r") at += 1;
      cell = csv.slice(from, at);
    }
    cells.push(cell);
    if (csv[at] === ",") {
      at += 1;
      if (at === csv.length || csv[at] === "\n") cells.push("");
    }
    if (csv[at] === "\r" && csv[at + 1] === "\n") end(2);
    else if (csv[at] === "\n") end(1);
  }
  if (cells.length) end(0);
  const [header, ...rest] = records;
  return { header, records: rest };
}

export const joined = ({ header }, records) => [header, ...records].map(({ text }) => `${text}\n`).join("");
