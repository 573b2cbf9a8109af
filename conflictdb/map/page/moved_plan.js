// A moved plan as text: a feature of a scene file, and SQL that moves the stored track.

const INSTANT = /^(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.(\d{1,6}))?Z$/;

// An instant of a scene file, so many microseconds later.
function later(text, us) {
  const [, seconds, fraction] = INSTANT.exec(text);
  const at = BigInt(Date.parse(`${seconds}Z`)) * 1000n + BigInt((fraction ?? "").padEnd(6, "0")) + BigInt(us);
  const micros = ((at % 1000000n) + 1000000n) % 1000000n;
  const whole = new Date(Number((at - micros) / 1000n)).toISOString().slice(0, 19);
  return `${whole}${micros === 0n ? "" : `.${String(micros).padStart(6, "0").replace(/0+$/, "")}`}Z`;
}

// The windows of a feature, so many microseconds later.
const windows = ({ properties }, us) => Object.fromEntries(["departure_window", "arrival_window"]
  .filter((name) => properties[name]).map((name) => [name, properties[name].map((text) => later(text, us))]));

// A height, or a list of them, so many metres higher; null: no limit.
const higher = (height, upM) => (Array.isArray(height) ? height.map((one) => higher(one, upM)) : Number.isFinite(height) ? height + upM : height);

// The feature of a track that departs so many microseconds later, so many metres higher, with a waypoint [n, lon, lat] elsewhere.
export function moved(feature, us, upM, waypoint) {
  const coordinates = feature.geometry.coordinates.map((place, n) => (waypoint?.[0] === n ? waypoint.slice(1) : place));
  const { properties } = feature;
  const ends = ["floor_m", "ceiling_m"].filter((name) => name in properties).map((name) => [name, higher(properties[name], upM)]);
  const times = ["times", "departures"].filter((name) => properties[name]).map((name) => [name, properties[name].map((text) => later(text, us))]);
  return { ...feature, geometry: { ...feature.geometry, coordinates }, properties: { ...properties, ...Object.fromEntries([...times, ...ends]), ...windows(feature, us) } };
}

const quoted = (text) => (/\\/.test(text) ? `E'${text.replace(/\\/g, "\\\\").replace(/'/g, "''")}'` : `'${text.replace(/'/g, "''")}'`);

// The statement that moves the track of a scene.
export function statement(scene, feature, us, upM, waypoint) {
  const moved = windows(feature, us);
  const within = us === 0 || Object.keys(moved).length === 0 ? "" : `,
    tolerances = tolerances || ${quoted(JSON.stringify(moved))}`;
  const [x, y] = waypoint ? waypoint.slice(1).map((degrees, i) => `CASE WHEN p.path[1] = ${waypoint[0] + 1} THEN ${degrees} ELSE ST_${"XY"[i]}(p.geom) END`) : ["ST_X(p.geom)", "ST_Y(p.geom)"];
  const each = (column, more) => `${column} = (SELECT array_agg(e.one + ${more} ORDER BY e.n) FROM unnest(t.${column}) WITH ORDINALITY AS e (one, n))`;
  const lists = ["floor_m", "ceiling_m"].filter((name) => Array.isArray(feature.properties[name])).map((name) => `,
    ${each(name.replace("_m", "s_m"), upM)}`).join("");
  const above = upM === 0 ? "" : `,
    floor_m = floor_m + ${upM}, ceiling_m = ceiling_m + ${upM}${lists}`;
  const departures = us === 0 || !feature.properties.departures ? "" : `,
    ${each("departures", `interval '${us} microseconds'`)}`;
  return `UPDATE conflictdb.track AS t
SET path = (SELECT ST_MakeLine(ST_SetSRID(ST_MakePointM(${x}, ${y}, ST_M(p.geom) + ${(us / 1e6).toFixed(6)}), 4326) ORDER BY p.path)
            FROM ST_DumpPoints(t.path) AS p)${above}${departures}${within}
FROM conflictdb.scene AS s
WHERE s.scene_id = t.scene_id AND s.name = ${quoted(scene)} AND t.key = ${quoted(feature.id)};
`;
}
