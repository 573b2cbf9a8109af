// The map as it is shown, under its headline, as a PNG.

import { colour, font } from "./theme.js";

const [HEAD_PX, MARGIN_PX] = [56, 12];

const isShown = (canvas) => canvas.checkVisibility({ visibilityProperty: true });

// Draws canvases on each other, `gl` when the map draws it: its picture is gone thereafter. Returns a Blob.
async function drawn(map, gl, above, [title, headline, instant]) {
  const { clientWidth: width, clientHeight: height } = map.getContainer();
  const canvas = document.createElement("canvas");
  const ratio = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [width * ratio, (height + HEAD_PX) * ratio];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.fillStyle = colour("paper");
  context.fillRect(0, 0, width, height + HEAD_PX);
  const draw = (one) => { if (isShown(one)) context.drawImage(one, 0, HEAD_PX, width, height); };
  await new Promise((resolve) => {
    map.once("render", () => { draw(gl); resolve(); });
    map.triggerRepaint();
  });
  above.forEach(draw);
  context.fillStyle = colour("ink");
  context.font = font("large", 600);
  context.fillText(title, MARGIN_PX, 24, width - 2 * MARGIN_PX);
  context.font = font("text");
  context.fillText(`${headline} · ${instant}`, MARGIN_PX, 45, width - 2 * MARGIN_PX);
  return new Promise((resolve) => { canvas.toBlob(resolve, "image/png"); });
}

// Saves the picture of a map (map.js) under the name of the scene.
export async function savePicture(map, above, texts) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await drawn(map, map.getCanvas(), above, texts));
  link.download = `${texts[0].replace(/[^\p{L}\p{N}_-]+/gu, "-")}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
