const DIGITS = 7; // what 32 bits hold, also far from the origin

// What the page's address says: #view=NAME, a stored camera at its own size; #at=…, a free one, with the lens of
// &lens=NAME or home's; &bare, no controls.
export function readAddress(hash) {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const at = (words.get("at") ?? "").split(",").map(Number);
  return {
    view: words.get("view"),
    at: at.length === 13 && at.every(Number.isFinite) ? at : null,
    lens: words.get("lens"),
    bare: words.has("bare"),
    layer: words.get("layer"),
    light: Number(words.get("light") ?? NaN),
    blend: Number(words.get("blend") ?? NaN),
    pack: Number(words.get("pack") ?? 1) - 1,
  };
}

// A free camera by its position, turn and reach.
export function addressOf({ exact, pose, stop, bare }, { layer, residual, pack, blend }) {
  const numbers = [...pose.position, ...pose.turn.flat(), pose.reach].map((value) => Number(value.toPrecision(DIGITS)));
  const words = exact ? [`view=${stop}`] : [`at=${numbers.join(",")}`];
  if (!exact && stop !== "home") words.push(`lens=${stop}`);
  if (layer !== "picture") words.push(`layer=${layer}`);
  if (residual !== 1) words.push(`light=${residual}`);
  if (pack) words.push(`pack=${pack + 1}`);
  if (blend) words.push(`blend=${blend}`);
  if (bare) words.push("bare");
  return `#${words.join("&")}`;
}
