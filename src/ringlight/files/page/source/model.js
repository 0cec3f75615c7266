// The model of this page: its facts, its tensors unpacked, and the texts of shaders and worker.
import { shortestAxes } from "./axes.js";
import { unpackTensors } from "./unpack.js";

export function modelOf(facts, payload) {
  const tensors = unpackTensors(payload),
    of = (name) => tensors.get(`columns.${name}`)?.values;
  const normals = of("normals") ?? shortestAxes(of("log_scales"), of("quats"));
  return { facts, tensors, parts: payload.parts, texts: payload.texts, normals };
}

// What the worker needs of it.
export function geometryOf({ tensors, facts, normals }) {
  const of = (name) => tensors.get(`columns.${name}`).values,
    mixed = tensors.get("color.opacity_basis") ?? tensors.get("color.varying.opacity_basis");
  return {
    means: of("means"),
    logScales: of("log_scales"),
    quats: of("quats"),
    opacityLogits: of("opacity_logits"),
    opacityRest: mixed ? mixedBy(of("basis_weights"), mixed) : tensors.get("columns.opacity_rest")?.values,
    opacityDegree: facts.opacityDegree,
    inLogits: Boolean(mixed),
    normals,
  };
}

// Harmonics of each Gaussian: its weights times what all share.
function mixedBy(weights, { values: shared, shape: [size, width] }) {
  const rest = new Float32Array((weights.length / size) * width);
  for (let at = 0; at < rest.length; at++) {
    const first = Math.floor(at / width) * size;
    let sum = 0;
    for (let j = 0; j < size; j++) sum += weights[first + j] * shared[width * j + (at % width)];
    rest[at] = sum;
  }
  return rest;
}
