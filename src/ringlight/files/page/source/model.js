// The model of this page: its facts, and its tensors unpacked.
import { shortestAxes } from "./axes.js";
import { readPayload } from "./payload.js";
import { unpackTensors } from "./unpack.js";

export async function readModel(document) {
  const facts = JSON.parse(document.getElementById("facts").textContent);
  const payload = await readPayload(document.getElementById("payload"));
  const tensors = unpackTensors(payload), of = (name) => tensors.get(`columns.${name}`)?.values;
  const normals = of("normals") ?? shortestAxes(of("log_scales"), of("quats"));
  return { facts, tensors, parts: payload.parts, normals };
}

// What the worker needs of it.
export function geometryOf({ tensors, normals }) {
  const of = (name) => tensors.get(`columns.${name}`).values;
  return { means: of("means"), logScales: of("log_scales"), quats: of("quats"), opacityLogits: of("opacity_logits"), normals };
}
