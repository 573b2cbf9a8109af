// When the heights of two pieces overlap, if either climbs: conflictdb/core/climbs.py. Heights are [floor at the start of
// the leg, floor at its end, ceiling at the start, ceiling at the end], metres.

const ROUNDING = 32 * 2 ** -52;
const HEIGHT_ROUNDING_M = 1e-9;

export const climbs = (heights) => heights[0] !== heights[1] || heights[2] !== heights[3];

// The floor and the ceiling at a share of a leg.
export function bandAt(heights, share) {
  const at = (from, to) => (from === to ? from : from + (to - from) * share);
  return [at(heights[0], heights[1]), at(heights[2], heights[3])];
}

// Cuts a time { first, last, error }, seconds, to when a floor is below a ceiling; both are linear in a span.
function narrow(time, low, high, lowTo, highTo, span) {
  const slack = ROUNDING * Math.max(0, ...[low, high, lowTo, highTo].map(Math.abs).filter(Number.isFinite));
  const [above, aboveTo] = [low - high, lowTo - highTo];
  const [isBelow, isBelowTo] = [above < -slack, aboveTo < -slack];
  if (isBelow && isBelowTo) {
    time.last = Math.min(time.last, span);
    time.first = Math.max(time.first, 0);
    return;
  }
  if (!isBelow && !isBelowTo) {
    time.first = Infinity;
    return;
  }
  const crossing = span * (above / (above - aboveTo));
  const doubt = span * ((2 * slack + 4 * HEIGHT_ROUNDING_M) / Math.abs(aboveTo - above) + ROUNDING);
  time.first = Math.max(time.first, isBelow ? 0 : Math.max(crossing - doubt, 0));
  time.last = Math.min(time.last, isBelow ? Math.min(crossing + doubt, span) : span);
  time.error = Math.max(time.error, 2 * doubt);
}

// When the heights of two pieces overlap during a time that both share, seconds from its start: { first, last, error }; first
// is later than last if they never do. shares: of the leg of each, at the start and at the end of that time.
export function overlapAtOneTime(a, b, sharesA, sharesB, span) {
  const time = { first: -Infinity, last: Infinity, error: 0 };
  if (!climbs(a) && !climbs(b)) return time;
  const bands = [sharesA.map((share) => bandAt(a, share)), sharesB.map((share) => bandAt(b, share))];
  [time.first, time.last] = [0, span];
  for (const [one, other] of [bands, [...bands].reverse()]) narrow(time, one[0][0], other[0][1], one[1][0], other[1][1], span);
  return time;
}

// When the heights of a climbing piece overlap those of another one at any of its times, seconds of its leg.
export function overlapOfLeg(heights, [low, high], span) {
  const time = { first: 0, last: span, error: 0 };
  narrow(time, heights[0], high, heights[1], high, span);
  narrow(time, low, heights[2], low, heights[3], span);
  return time;
}

// Whether heights of two pieces overlap whenever both are there.
export const surelyOverlap = (a, b) => Math.max(a[0], a[1]) < Math.min(b[2], b[3]) && Math.max(b[0], b[1]) < Math.min(a[2], a[3]);
