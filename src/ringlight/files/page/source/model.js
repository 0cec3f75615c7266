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
  const of = (name) => tensors.get(`columns.${name}`).values;
  return {
    means: of("means"),
    logScales: of("log_scales"),
    quats: of("quats"),
    opacityLogits: of("opacity_logits"),
    opacityRest: tensors.get("columns.opacity_rest")?.values,
    opacityDegree: facts.opacityDegree,
    normals,
  };
}
