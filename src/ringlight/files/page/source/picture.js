// Pictures of one model on one canvas: the worker's lists go in, pixels come out.
import { EnvironmentKind } from "./environment_kind.js";
import { numbered, Texture } from "./gl.js";
import { inLightOf, lightShares } from "./lights.js";
import { MirrorKind } from "./mirror_kind.js";
import { ELLIPSE } from "./projection.js";
import { ShadedKind } from "./shaded_kind.js";
import { SplatKind } from "./splat_kind.js";

const LIST_WIDTH = 2048,
  LIST_ROWS = 4096,
  TILE_ROOM = 1 << 16;

export const LAYERS = ["picture", "base", "normals", "depth"];

export class Picture {
  constructor(canvas, shaders, model) {
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      alpha: false,
      depth: false,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("it has no WebGL2");
    Object.assign(this, { gl, canvas, facts: model.facts });
    const own = { mirror: MirrorKind, environment: EnvironmentKind, shaded: ShadedKind },
      Kind = own[model.facts.kind] ?? SplatKind;
    this.make = (lit) => new Kind(gl, shaders, lit);
    this.model = model;
    this.kind = this.make(model);
    this.relit = new Map(); // kinds in the light of a pack, by its number; made when first asked for
    this.ellipses = numbered(gl, "rgba32f", 2 * model.facts.gaussians);
    this.seen = { rows: new Uint32Array(model.facts.gaussians), count: 0 }; // nearest first
    this.tiles = null;
    this.entries = null;
    this.most = LIST_WIDTH * Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE), LIST_ROWS);
    this.drawn = 0;
  }

  // Empty buffers for the worker, which come back with each picture's lists.
  buffers() {
    const rows = this.ellipses.height;
    return {
      ellipses: new Float32Array(4 * LIST_WIDTH * rows),
      tiles: new Uint32Array(2 * TILE_ROOM),
      entries: new Uint32Array(LIST_WIDTH * 64),
    };
  }

  load(lists) {
    const gl = this.gl;
    this.ellipses.write(lists.ellipses, 2 * lists.count);
    for (let place = 0; place < lists.count; place++)
      this.seen.rows[place] = Math.abs(lists.ellipses[ELLIPSE * place + 3]) - 1;
    this.seen.count = lists.count;
    if (this.tiles?.width !== lists.across || this.tiles.height !== lists.down) {
      this.tiles?.free();
      this.tiles = new Texture(gl, "rg32ui", lists.across, lists.down);
    }
    this.tiles.write(lists.tiles, lists.across * lists.down);
    const rows = Math.max(Math.floor(lists.entries.length / LIST_WIDTH), 1);
    if (this.entries?.height !== rows) {
      this.entries?.free();
      this.entries = new Texture(gl, "r32ui", LIST_WIDTH, rows);
    }
    this.entries.write(lists.entries, lists.total);
    this.lists = lists;
  }

  // Draw what was loaded: in the model's own light, and over it by the share `blend` in that of pack number `pack`.
  // With `some` colours may be of a moment ago; true where all is exact.
  draw({ layer, residual, background, some, pack = 0, blend = 0 }, target = null) {
    const [width, height] = this.lists.camera.size;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const shares = lightShares(layer, this.facts.lights?.[pack] ? blend : 0);
    const amount = layer === "base" ? 0 : this.facts.lit ? residual : 0;
    let exact = true;
    shares.forEach((share, number) => {
      if (!share) return;
      const kind = number ? this.inLightOf(pack) : this.kind;
      exact = this.drawKind(kind, { layer, amount, background, some }, target, share) && exact;
    });
    this.drawn++;
    return exact;
  }

  inLightOf(pack) {
    if (!this.relit.has(pack)) this.relit.set(pack, this.make(inLightOf(this.model, pack)));
    return this.relit.get(pack);
  }

  // With a `share` below one over what is there.
  drawKind(kind, { layer, amount, background, some }, target, share) {
    const { gl, lists } = this,
      { camera, side } = lists;
    const exact = kind.prepare({ camera, seen: this.seen }, amount, some);
    const program = kind.bound({ ellipses: this.ellipses, tiles: this.tiles, entries: this.entries }, camera, amount);
    program.wholes({ size: camera.size, side, layer: LAYERS.indexOf(layer) });
    program.numbers({ background, nearFar: this.facts.nearFar });
    if (share < 1) {
      gl.enable(gl.BLEND);
      gl.blendColor(0, 0, 0, share);
      gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    }
    program.draw(target, ...camera.size);
    gl.disable(gl.BLEND);
    return exact;
  }

  // The picture that was drawn last, again and unrounded: red, green, blue and one, from the lowest row on. For tests;
  // null where the browser cannot draw into floats.
  values(look) {
    const gl = this.gl,
      { width, height } = this.canvas;
    if (!gl.getExtension("EXT_color_buffer_float") || !gl.getExtension("EXT_float_blend")) return null;
    const texture = new Texture(gl, "rgba32f", width, height),
      target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture.texture, 0);
    this.draw({ ...look, some: false }, target);
    const values = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, values);
    gl.deleteFramebuffer(target);
    texture.free();
    return values;
  }
}
