// 3dgs-dr: harmonics as base colours, and a distant environment that each pixel reflects.
import { Colors } from "./colors.js";
import { cubemapTexture } from "./cubemap.js";
import { inTexels, numbered, programOf } from "./gl.js";
import { harmonicsOf } from "./splat_kind.js";

export class EnvironmentKind {
  constructor(gl, shaders, model) {
    const { tensors, facts, normals } = model,
      strengths = tensors.get("columns.reflection_logits").values,
      surfaces = new Float32Array(4 * facts.gaussians);
    for (let row = 0; row < facts.gaussians; row++) {
      surfaces.set(normals.subarray(3 * row, 3 * row + 3), 4 * row);
      surfaces[4 * row + 3] = sigmoid(strengths[row]);
    }
    const texels = tensors.get("shader.texels").values.map(sigmoid);
    this.textures = {
      surfaces: numbered(gl, "rgba32f", facts.gaussians, surfaces),
      environment: cubemapTexture(gl, texels, facts.sizes.ENVIRONMENT_SIDE),
    };
    const source = harmonicsOf(gl, model),
      means = numbered(gl, "rgba32f", facts.gaussians, inTexels(tensors.get("columns.means").values, 3));
    const recolor = programOf(gl, shaders, ["numbered.glsl", "harmonics.glsl", "harmonics_main.glsl"], facts.sizes);
    this.colored = new Colors(gl, recolor, facts.gaussians, { ...source, textures: { means, ...source.textures } });
    const picture = [
      "numbered.glsl",
      "layers.glsl",
      "blend_head.glsl",
      "environment_channels.glsl",
      "blend.glsl",
      "surface.glsl",
      "cubemap.glsl",
      "environment_main.glsl",
    ];
    this.program = programOf(gl, shaders, picture, facts.sizes);
  }

  // Base colours are whole whatever the fader says: it fades what is reflected.
  prepare(view, _, some) {
    return this.colored.prepare(view, 1, some);
  }

  bound(lists, { pose, focal, center }, residual) {
    const [a, b, c, , d, e, f, , g, h, i] = pose,
      toWorld = [a, b, c, d, e, f, g, h, i]; // the rotation's transpose, columns first
    const program = this.program.use().textures({ ...lists, ...this.textures, colors: this.colored.colors });
    return program.numbers({ toWorld, focal, center, light: residual });
  }
}

const sigmoid = (value) => 1 / (1 + Math.exp(-value));
