// Models whose Gaussians are coloured each by itself: harmonics, a shared basis of them, the ring, 3igs.
import { Colors } from "./colors.js";
import { inTexels, numbered, programOf } from "./gl.js";
import { axisTable, viewTable } from "./heads.js";
import { illuminatedOf } from "./illuminated.js";
import { inFours, layersOf } from "./networks.js";

// Gaussians with one colour each, made by `colored`, seen through the shaders' file `code`; rows of `normals`.
export class ColoredKind {
  constructor(gl, shaders, colored, normals, code) {
    this.colored = colored;
    this.normals = normals;
    const picture = ["numbered.glsl", "layers.glsl", "blend_head.glsl", code, "blend.glsl", "splat_main.glsl"];
    this.program = programOf(gl, shaders, picture);
  }

  // Bring the colours up to date; with `some` only a part of them, if there are many. True once all are.
  prepare(view, residual, some) {
    return this.colored.prepare(view, residual, some);
  }

  // The program of pictures with what is this kind's own.
  bound(lists) {
    return this.program.use().textures({ ...lists, colors: this.colored.colors, normals: this.normals });
  }
}

export class SplatKind extends ColoredKind {
  constructor(gl, shaders, model) {
    const rows = model.facts.gaussians,
      normals = numbered(gl, "rgba32f", rows, inTexels(model.normals, 3));
    super(gl, shaders, coloredOf(gl, shaders, model), normals, "splat_color.glsl");
  }
}

function coloredOf(gl, shaders, model) {
  const { tensors, facts } = model,
    means = numbered(gl, "rgba32f", facts.gaussians, inTexels(tensors.get("columns.means").values, 3));
  const [sourceOf, ...code] = SOURCES[facts.kind] ?? [harmonicsOf, "harmonics.glsl", "harmonics_main.glsl"];
  const source = sourceOf(gl, model);
  const recolor = programOf(gl, shaders, ["numbered.glsl", ...code], { ...facts.sizes, ...source.sizes });
  return new Colors(gl, recolor, facts.gaussians, { ...source, textures: { means, ...source.textures } });
}

// Constant coefficients of each Gaussian, and what it has of the direction, as the file holds it.
export function harmonicsOf(gl, { tensors, parts, facts }) {
  const textures = { dc: numbered(gl, "rgba32f", facts.gaussians, inTexels(tensors.get("columns.sh_dc").values, 3)) };
  if (facts.kind === "basis") Object.assign(textures, basisOf(gl, tensors, "color.basis"));
  else {
    const { codes, low, step } = parts.get("columns.sh_rest"),
      width = low.values.length;
    const scales = Float32Array.from({ length: 4 * width }, (_, k) =>
      k % 4 > 1 ? 0 : (k % 4 ? step : low).values[k >> 2],
    );
    const texels = width ? inTexels(codes.values, width) : new Uint8Array(4);
    textures.codes = numbered(gl, "rgba8ui", texels.length / 4, texels);
    textures.scales = numbered(gl, "rgba32f", Math.max(width, 1), width ? scales : new Float32Array(4));
  }
  return { textures, wholes: { degree: facts.degree } };
}

// Weights of each Gaussian, and the shared functions that they mix.
export function basisOf(gl, tensors, name) {
  const weights = tensors.get("columns.basis_weights"),
    basis = tensors.get(name).values;
  const texels = inTexels(weights.values, weights.shape[1]);
  return {
    weights: numbered(gl, "rgba32f", texels.length / 4, texels),
    basis: numbered(gl, "rgba32f", basis.length / 3, inTexels(basis, 3)),
  };
}

function ringOf(gl, { tensors, facts }) {
  const { ring, box } = facts,
    { RANK, FEATURES, NODES, VIEW_SIDE } = facts.sizes,
    square = RANK * RANK;
  const axes = axisTable(tensors, "color.ring.axes", 3, NODES, ring.code);
  const view = viewTable(tensors, "color.ring.view", VIEW_SIDE, ring.viewCode);
  const cores =
    tensors.get("color.ring.core")?.values ?? axisTable(tensors, "color.ring.channels", 1, FEATURES, ring.code);
  // The trace with G is the product's rows against G's columns.
  const core = new Float32Array(cores.length);
  cores.forEach((value, k) => {
    const within = k % square;
    core[k - within + (within % RANK) * RANK + Math.floor(within / RANK)] = value;
  });
  const names = [...layersOf(tensors, "color.shading.modulation"), ...layersOf(tensors, "color.shading.render")];
  const shading = inFours(tensors, names);
  const inFour = (values) => numbered(gl, "rgba32f", values.length / 4, values);
  return {
    textures: {
      axes: inFour(axes),
      view: inFour(view),
      core: inFour(core),
      shading: inFour(shading),
      surfaces: inFour(surfacesOf(tensors)),
    },
    numbers: { gain: ring.gain, boxLow: box[0], boxSize: box[1].map((high, k) => high - box[0][k]) },
  };
}

// What makes the textures and numbers of a kind, and the shader that takes them.
const SOURCES = { ring: [ringOf, "ring.glsl"], illuminated: [illuminatedOf, "illuminated.glsl"] };

// Base colours, other three-vectors and latents of each Gaussian, in texels.
export function surfacesOf(tensors, normals = null) {
  const base = tensors.get("columns.base").values,
    latents = tensors.get("columns.latents"),
    rows = base.length / 3;
  const count = latents?.shape[1] ?? 0,
    head = normals ? 8 : 4,
    width = head + 4 * Math.ceil(count / 4);
  const found = new Float32Array(width * rows);
  for (let row = 0; row < rows; row++) {
    for (let k = 0; k < 3; k++) {
      found[width * row + k] = 1 / (1 + Math.exp(-base[3 * row + k]));
      if (normals) found[width * row + 4 + k] = normals[3 * row + k];
    }
    for (let k = 0; k < count; k++) found[width * row + head + k] = latents.values[count * row + k];
  }
  return found;
}
