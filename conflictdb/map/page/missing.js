// How much of the separation of a conflict is missing, in the words of core/ranking.py: "inside by 4.7 nmi".

import { mostDistance } from "./format.js";

export const missingText = ({ missing: [word, m] }) => (m === null ? word : `${word} by ${mostDistance(m)}`);
