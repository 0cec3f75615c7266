// Models whose Gaussians are coloured each by itself: harmonics, a shared basis of them, the ring. Colours are made
// again only when the camera's position or the fader changes.
import { inTexels, numbered, Program, Texture, texelRows } from "./gl.js";
import { axisTable, viewTable } from "./heads.js";
import { inFours, layersOf } from "./networks.js";

const HEIGHT_AT_ONCE = 8; // rows of 2048 Gaussians that a moving camera recolours in one picture

export class SplatKind {
  constructor(gl, shaders, model) {
    const { tensors, facts } = model,
      means = tensors.get("columns.means").values;
    this.gl = gl;
    this.rows = facts.gaussians;
    const shared = { means: numbered(gl, "rgba32f", this.rows, inTexels(means, 3)) };
    this.normals = numbered(gl, "rgba32f", this.rows, inTexels(model.normals, 3));
    const source = facts.kind === "ring" ? ringOf(gl, model) : harmonicsOf(gl, model);
    this.textures = { ...shared, ...source.textures };
    this.constants = source;
    const code = facts.kind === "ring" ? "ring.glsl" : "harmonics.glsl";
    this.recolor = new Program(gl, [shaders["numbered.glsl"], shaders[code]], facts.sizes);
    const picture = [
      "numbered.glsl",
      "layers.glsl",
      "blend_head.glsl",
      "splat_color.glsl",
      "blend.glsl",
      "splat_main.glsl",
    ];
    this.program = new Program(
      gl,
      picture.map((name) => shaders[name]),
    );
    this.colors = new Texture(gl, "rgba32ui", 2048, texelRows(this.rows));
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.colors.texture, 0);
    // Camera position and fader of the colours, how many rows of 2048 are still of earlier ones, and the next of them.
    this.made = null;
  }

  // Bring the colours up to date; with `some` only a part of them, if there are many. True once all are.
  prepare(camera, residual, some) {
    const wish = [...camera.position, residual].join(),
      height = this.colors.height;
    if (this.made?.wish !== wish) this.made = { wish, left: height, next: this.made?.next ?? 0 };
    if (!this.made.left) return true;
    const gl = this.gl,
      lines = some ? Math.min(HEIGHT_AT_ONCE, this.made.left) : this.made.left;
    const first = this.made.next,
      { numbers = {}, wholes = {} } = this.constants;
    this.recolor
      .use()
      .textures(this.textures)
      .numbers({ ...numbers, position: camera.position, residual });
    this.recolor.wholes({ ...wholes, rows: this.rows });
    gl.enable(gl.SCISSOR_TEST);
    for (let line = 0; line < lines;) {
      const from = (first + line) % height,
        here = Math.min(lines - line, height - from);
      gl.scissor(0, from, 2048, here);
      this.recolor.draw(this.target, 2048, height);
      line += here;
    }
    gl.disable(gl.SCISSOR_TEST);
    this.made.next = (first + lines) % height;
    this.made.left -= lines;
    return this.made.left === 0;
  }

  // The program of pictures with what is this kind's own.
  bound(lists) {
    return this.program.use().textures({ ...lists, colors: this.colors, normals: this.normals });
  }
}

function harmonicsOf(gl, { tensors, parts, facts }) {
  const textures = { dc: numbered(gl, "rgba32f", facts.gaussians, inTexels(tensors.get("columns.sh_dc").values, 3)) };
  if (facts.kind === "basis") {
    const weights = tensors.get("columns.basis_weights"),
      basis = tensors.get("color.basis").values;
    const texels = inTexels(weights.values, weights.shape[1]);
    textures.weights = numbered(gl, "rgba32f", texels.length / 4, texels);
    textures.basis = numbered(gl, "rgba32f", basis.length / 3, inTexels(basis, 3));
  } else {
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
    numbers: { boxLow: box[0], boxSize: box[1].map((high, k) => high - box[0][k]) },
  };
}

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
