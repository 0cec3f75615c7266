// Linear layers as a shader multiplies them: for four outputs at a time the weights of each input, then the bias.
export function inFours(tensors, names) {
  const found = [];
  for (const name of names) {
    const weight = tensors.get(`${name}.weight`),
      bias = tensors.get(`${name}.bias`).values,
      [outputs, inputs] = weight.shape;
    for (let first = 0; first < outputs; first += 4) {
      for (let input = 0; input <= inputs; input++) {
        for (let k = first; k < first + 4; k++) {
          found.push(k >= outputs ? 0 : input === inputs ? bias[k] : weight.values[k * inputs + input]);
        }
      }
    }
  }
  return Float32Array.from(found);
}

// Names of a network's layers, "name.0", "name.2", …: with a ReLU in between each.
export const layersOf = (tensors, name) => {
  const found = [];
  for (let depth = 0; tensors.has(`${name}.${depth}.weight`); depth += 2) found.push(`${name}.${depth}`);
  return found;
};

// One of a stack's networks, as layers { weight [inputs outputs], bias, inputs, outputs }.
export function stackOf(tensors, name, head) {
  const layers = [];
  for (let depth = 0; tensors.has(`${name}.weights.${depth}`); depth++) {
    const weight = tensors.get(`${name}.weights.${depth}`),
      [, inputs, outputs] = weight.shape;
    const bias = tensors.get(`${name}.biases.${depth}`).values;
    layers.push({
      inputs,
      outputs,
      weight: weight.values.subarray(head * inputs * outputs, (head + 1) * inputs * outputs),
      bias: bias.subarray(head * outputs, (head + 1) * outputs),
    });
  }
  return layers;
}
