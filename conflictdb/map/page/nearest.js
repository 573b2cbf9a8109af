// What an object comes nearest to at its heights, and when, by the kernel, which proves that nothing else comes nearer.

import { alone, atHeights, heightsUnder, pairsNear, together, unpackPieces } from "./near.js";

const REACHES_M = [1e3, 1e4, 1e5, 1e6]; // so far it is looked for, one after the other
export const FARTHEST_M = REACHES_M.at(-1);

// { other (a key), m, error, t } of the others of a source; t is infinite of two that stand still. Null: none is within the last reach at
// its times and heights.
export async function nearestOf(kernel, source, key) {
  for (const reachM of REACHES_M) {
    const found = nearestIn(kernel, unpackPieces(await source.piecesNear(key, reachM)), key, reachM);
    if (found !== null) return found;
  }
  return null;
}

// The same within a reach, of the pieces of a pack. Throws an error for an object that cannot be cut: it may be nearer than all others.
export function nearestIn(kernel, pack, key, reachM) {
  const object = pack.objects.indexOf(key);
  if (object < 0) return null;
  const near = pairsNear(kernel, pack, object, { reachM, isTimed: true, heights: heightsUnder(pack, 0), isAllowed: true });
  if (!near.length) return null;
  const covered = near.find(({ isCovered }) => isCovered);
  if (covered) {
    const unknown = pack.is_cover[covered.mine] ? covered.mine : covered.other;
    throw new Error(`where ${pack.objects[pack.object[unknown]]} is, and when, cannot be computed`);
  }
  const { pieces, pairs } = alone(pack, near);
  const ofObject = ({ other }) => pieces.object[other];
  pairs.sort((one, two) => ofObject(one) - ofObject(two));
  const asked = atHeights(kernel, { ...pieces, ...heightsUnder(pieces, 0) }, together(pieces, pairs.map(({ mine, other }) => ({ a: mine, b: other }))));
  const left = asked.left.map((n) => pairs[n]);
  const begins = left.flatMap((pair, n) => (n === 0 || ofObject(pair) !== ofObject(left[n - 1]) ? [n] : []));
  const offset = BigInt64Array.from([...begins, left.length], BigInt);
  const groups = kernel.withScene(pieces, null, (scene) => kernel.approaches(scene, asked, offset, reachM));
  const best = groups.reduce((least, one) => (one.pair >= 0 && (least === null || one.m < least.m) ? one : least), null);
  if (best === null) return null;
  const { mine, other } = left[best.pair];
  const isStill = pieces.moves[mine] === 0 && pieces.moves[other] === 0;
  const t = isStill ? Infinity : (Number(BigInt(pack.base_us) + asked.zero[best.pair]) / 1e6) + best.at;
  return { other: pack.objects[ofObject({ other })], m: best.m, error: best.error, t };
}
