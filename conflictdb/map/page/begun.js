// What a first view reads, requested before the modules of the page have arrived: of the scene that a server shows first.

const PATHS = ["api/scene", "api/conflicts", "api/areas", "api/tracks", "page/kernel.wasm"];
export const LARGE = 2000; // a scene of more objects has an overview

const begun = new Map();
const asked = new Set();

function begin(path) {
  if (asked.has(path)) return null;
  const answer = fetch(path);
  answer.catch(() => null); // who asks for it says so
  begun.set(path, answer);
  return answer;
}

async function beginOverview(scene) {
  const { objects } = await (await scene).clone().json();
  if (objects > LARGE) begin("api/overview");
}

// The answer of a path, requested now unless it has been; once.
export function requested(path) {
  const answer = begun.get(path) ?? fetch(path);
  begun.delete(path);
  asked.add(path);
  return answer;
}

if (!document.getElementById("scene-data") && !new URLSearchParams(location.hash.slice(1)).has("scene")) {
  const [scene] = PATHS.map(begin);
  beginOverview(scene).catch(() => null);
}
