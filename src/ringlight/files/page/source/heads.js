// The ring's heads: small networks of a coordinate or a direction, run at the nodes of their tables once; the twin of
// fields/heads.py and fields/encoding.py. The file holds the networks, which are far smaller than their tables.
import { stackOf } from "./networks.js";

// Sines and cosines in octaves of each coordinate, behind the coordinates themselves unless these are left out.
function encoded(values, { bands, pi, identity }) {
  const found = identity ? [...values] : [],
    scale = pi ? Math.PI : 1;
  for (const value of values) {
    for (let k = 0; k < bands; k++) found.push(Math.sin(value * scale * 2 ** k));
    for (let k = 0; k < bands; k++) found.push(Math.cos(value * scale * 2 ** k));
  }
  return found;
}

function run(layers, values) {
  layers.forEach(({ inputs, outputs, weight, bias }, depth) => {
    const sums = Float64Array.from(bias);
    for (let i = 0; i < inputs; i++) {
      const value = depth ? Math.max(values[i], 0) : values[i];
      if (value === 0) continue;
      for (let o = 0; o < outputs; o++) sums[o] += value * weight[i * outputs + o];
    }
    values = sums;
  });
  return values;
}

const nodesOf = (count) => Array.from({ length: count }, (_, node) => (2 * node) / (count - 1) - 1);

// [heads, nodes, outputs] of heads that see one coordinate each.
export function axisTable(tensors, name, heads, nodes, code) {
  const outputs = stackOf(tensors, `${name}.networks`, 0).at(-1).outputs,
    table = new Float32Array(heads * nodes * outputs);
  for (let head = 0; head < heads; head++) {
    const layers = stackOf(tensors, `${name}.networks`, head);
    nodesOf(nodes).forEach((at, node) => {
      table.set(run(layers, encoded([at], code)), (head * nodes + node) * outputs);
    });
  }
  return table;
}

// [side * side, outputs], row j * side + i for node (i, j) of the octahedral square.
export function viewTable(tensors, name, side, code) {
  const layers = stackOf(tensors, `${name}.networks`, 0),
    outputs = layers.at(-1).outputs;
  const table = new Float32Array(side * side * outputs),
    nodes = nodesOf(side);
  nodes.forEach((v, row) =>
    nodes.forEach((u, column) => {
      table.set(run(layers, encoded(directionAt(u, v), code)), (row * side + column) * outputs);
    }),
  );
  return table;
}

export function directionAt(u, v) {
  const z = 1 - Math.abs(u) - Math.abs(v),
    fold = Math.max(-z, 0);
  const x = u + (u >= 0 ? -fold : fold),
    y = v + (v >= 0 ? -fold : fold),
    length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}
