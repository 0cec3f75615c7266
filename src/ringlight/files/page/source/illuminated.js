// 3igs as Python condenses it for a page: components of each Gaussian and one network; the twin of
// color/condensed_illumination.py and, of the code's factors, of fields/directional_encoding.py.
import { inTexels, numbered } from "./gl.js";
import { stackOf } from "./networks.js";

const LEVELS = [1, 2, 4, 8],
  ROUGHNESS_SHIFT = 1,
  AT_ONCE = 3 * 2048; // of Gaussians as many as read the texels that the usual number of a ring's do
const PAIRS = LEVELS.flatMap((level) => Array.from({ length: level + 1 }, (_, order) => [level, order]));

export function illuminatedOf(gl, { tensors, facts }) {
  const coded = tensors.get("columns.features"),
    width = coded.shape[1],
    [first, ...others] = stackOf(tensors, "color.network", 0);
  const network = [...layerInFours(first, seenBy(width)), ...others.flatMap((layer) => layerInFours(layer))];
  const surfaces = surfacesOf(tensors, inTexels(coded.values.map(Math.tanh), width), facts.gaussians);
  return {
    textures: {
      surfaces: numbered(gl, "rgba32f", surfaces.length / 4, surfaces),
      network: numbered(gl, "rgba32f", network.length / 4, Float32Array.from(network)),
    },
    sizes: { COMPONENT_TEXELS: Math.ceil(width / 4), CODES: PAIRS.length },
    atOnce: AT_ONCE,
  };
}

// Inputs of the first layer in the shader's order, each its row and a factor: components, the direction, and the code's
// real and imaginary parts next to each other, each group filled up to fours. Behind the components Python has as many
// of a field, which are zero.
function seenBy(width) {
  const direction = 2 * width,
    code = direction + 3;
  const inFours = (inputs) => [...inputs, ...Array(-inputs.length & 3).fill(null)];
  const parts = PAIRS.flatMap(([level, order], pair) => {
    const factor = harmonicFactor(level, order);
    return [code + pair, code + PAIRS.length + pair].map((row) => ({ row, factor }));
  });
  const rows = (from, count) => Array.from({ length: count }, (_, k) => ({ row: from + k, factor: 1 }));
  return [...inFours(rows(0, width)), ...inFours(rows(direction, 3)), ...inFours(parts)];
}

// What makes a derivative of a Legendre polynomial an orthonormal harmonic.
function harmonicFactor(level, order) {
  let ratio = 1; // (level - order)! / (level + order)!
  for (let k = level - order + 1; k <= level + order; k++) ratio /= k;
  return (order % 2 ? -1 : 1) * Math.sqrt(((2 * level + 1) / (4 * Math.PI)) * ratio);
}

// For four outputs at a time the weights of each input, then the bias.
function layerInFours({ inputs, outputs, weight, bias }, seen = null) {
  const rows = seen ?? Array.from({ length: inputs }, (_, row) => ({ row, factor: 1 })),
    found = [];
  for (let first = 0; first < outputs; first += 4) {
    const four = [0, 1, 2, 3].map((k) => first + k);
    for (const input of rows)
      found.push(...four.map((k) => (input && k < outputs ? input.factor * weight[input.row * outputs + k] : 0)));
    found.push(...four.map((k) => (k < outputs ? bias[k] : 0)));
  }
  return found;
}

// Base colour and roughness of each Gaussian, then its components.
function surfacesOf(tensors, components, rows) {
  const base = tensors.get("columns.base").values,
    stored = tensors.get("columns.roughness").values,
    width = components.length / rows,
    found = new Float32Array((4 + width) * rows);
  for (let row = 0; row < rows; row++) {
    const at = (4 + width) * row;
    for (let k = 0; k < 3; k++) found[at + k] = 1 / (1 + Math.exp(-base[3 * row + k]));
    found[at + 3] = Math.log1p(Math.exp(stored[row] - ROUGHNESS_SHIFT));
    found.set(components.subarray(width * row, width * (row + 1)), at + 4);
  }
  return found;
}
