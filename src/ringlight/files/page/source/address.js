const DIGITS = 7; // what 32 bits hold, also far from the origin

// What the page's address says: #view=NAME, a stored camera at its own size; #at=…, a free one; &bare, no controls.
export function readAddress(hash) {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const at = (words.get("at") ?? "").split(",").map(Number);
  return {
    view: words.get("view"),
    at: at.length === 13 && at.every(Number.isFinite) ? at : null,
    bare: words.has("bare"),
    layer: words.get("layer"),
    light: words.has("light") ? Number(words.get("light")) : null,
    blend: words.has("blend") ? Number(words.get("blend")) : null,
    pack: Number(words.get("pack") ?? 1) - 1,
  };
}

// Position, turn and reach of a free camera.
export function addressOf(pose, { layer, residual, pack, blend }, bare) {
  const numbers = [...pose.position, ...pose.turn.flat(), pose.reach].map((value) => Number(value.toPrecision(DIGITS)));
  const words = [`at=${numbers.join(",")}`];
  if (layer !== "picture") words.push(`layer=${layer}`);
  if (residual !== 1) words.push(`light=${residual}`);
  if (pack) words.push(`pack=${pack + 1}`);
  if (blend) words.push(`blend=${blend}`);
  if (bare) words.push("bare");
  return `#${words.join("&")}`;
}
