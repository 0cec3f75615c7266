// Light packs: the model in other light has other tensors where the pack has some; the twin of runs/light_pack.py.
const C0 = 0.28209479177387814;

// Of the own light and of a pack's: what each draws over what was drawn before. Shapes are the same in any light.
export function lightShares(layer, blend) {
  const colored = layer === "picture" || layer === "base";
  if (!colored || blend <= 0) return [1, 0];
  return blend >= 1 ? [0, 1] : [1, blend];
}

export function inLightOf(model, pack) {
  const tensors = new Map(model.tensors),
    prefix = `light.${pack}.`;
  for (const [name, tensor] of model.tensors) {
    if (name.startsWith(prefix)) tensors.set(name.slice(prefix.length), tensor);
  }
  const colors = tensors.get("colors");
  if (colors) {
    const constant = tensors.get("columns.sh_dc");
    tensors.set("columns.sh_dc", { ...constant, values: recolored(constant.values, colors.values) });
  }
  return { ...model, tensors };
}

// Constant coefficients whose base colours are changed by [3 4] factors of red, green, blue and one.
function recolored(constants, colors) {
  const found = new Float32Array(constants.length);
  for (let row = 0; row < constants.length; row += 3) {
    for (let c = 0; c < 3; c++) {
      let sum = colors[4 * c + 3];
      for (let k = 0; k < 3; k++) sum += colors[4 * c + k] * (0.5 + C0 * constants[row + k]);
      found[row + c] = (sum - 0.5) / C0;
    }
  }
  return found;
}
