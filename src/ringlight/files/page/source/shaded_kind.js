// gaussian-shader: each Gaussian reflects a learned environment, as rough as it is.
import { Colors } from "./colors.js";
import { borderedFaces } from "./cubemap.js";
import { inTexels, numbered, programOf } from "./gl.js";
import { ColoredKind, harmonicsOf } from "./splat_kind.js";

const SMOOTHEST = 0.08; // roughness whose logit is far below zero

export class ShadedKind extends ColoredKind {
  constructor(gl, shaders, model) {
    const normals = numbered(gl, "rgba32f", 2 * model.facts.gaussians, sidesOf(model));
    super(gl, shaders, coloredOf(gl, shaders, model, normals), normals, "shaded_color.glsl");
  }
}

function coloredOf(gl, shaders, model, normals) {
  const { tensors, facts } = model,
    rows = facts.gaussians,
    { textures, wholes } = harmonicsOf(gl, model),
    means = numbered(gl, "rgba32f", rows, inTexels(tensors.get("columns.means").values, 3)),
    surfaces = numbered(gl, "rgba32f", 2 * rows, surfacesOf(model)),
    { values, shape } = tensors.get("shares"),
    light = { ...lightOf(gl, model), shares: numbered(gl, "rgba32f", shape[0], inTexels(values, 2)) };
  const recolor = ["numbered.glsl", "harmonics.glsl", "cubemap.glsl", "shaded_main.glsl"];
  return new Colors(gl, programOf(gl, shaders, recolor, facts.sizes), rows, {
    textures: { means, ...textures, normals, surfaces, ...light },
    wholes,
  });
}

// Normals where the shortest axis looks towards the camera as it is stored, and where it is turned round.
function sidesOf({ tensors, facts, normals }) {
  const residuals = tensors.get("columns.normal_residuals").values,
    found = new Float32Array(8 * facts.gaussians);
  for (let side = 0; side < 2 * facts.gaussians; side++) {
    const row = side >> 1,
      turn = side & 1 ? -1 : 1;
    const normal = [0, 1, 2].map((k) => turn * normals[3 * row + k] + residuals[3 * side + k]),
      length = Math.max(Math.hypot(...normal), 1e-12);
    for (let k = 0; k < 3; k++) found[4 * side + k] = normal[k] / length;
  }
  return found;
}

// Of each Gaussian the axis that says which side is seen, its roughness, and its tint.
function surfacesOf({ tensors, facts, normals }) {
  const tints = tensors.get("columns.tint_logits").values,
    roughness = tensors.get("columns.roughness_logits").values,
    found = new Float32Array(8 * facts.gaussians);
  for (let row = 0; row < facts.gaussians; row++) {
    for (let k = 0; k < 3; k++) {
      found[8 * row + k] = normals[3 * row + k];
      found[8 * row + 4 + k] = sigmoid(tints[3 * row + k]);
    }
    found[8 * row + 3] = SMOOTHEST + (1 - SMOOTHEST) * sigmoid(roughness[row]);
  }
  return found;
}

// The blurred environments, bordered, one after the other, and where each begins.
function lightOf(gl, { tensors, facts }) {
  const colors = tensors.get("color.light.maps").values,
    levels = new Float32Array(4 * facts.levels.length),
    found = [];
  let from = 0,
    texels = 0;
  facts.levels.forEach(([side, roughness], level) => {
    const faces = borderedFaces(colors.subarray(from, (from += 18 * side * side)), side);
    levels.set([side, texels, roughness], 4 * level);
    texels += faces.length / 4;
    found.push(faces);
  });
  const maps = new Float32Array(4 * texels);
  found.forEach((faces, level) => maps.set(faces, 4 * levels[4 * level + 1]));
  return { maps: numbered(gl, "rgba32f", texels, maps), levels: numbered(gl, "rgba32f", found.length, levels) };
}

const sigmoid = (value) => 1 / (1 + Math.exp(-value));
