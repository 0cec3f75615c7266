// Mirrors: channels are blended, and each pixel is shaded once by the trained network.
import { Colors } from "./colors.js";
import { inTexels, numbered, programOf, Texture } from "./gl.js";
import { inFours, layersOf } from "./networks.js";
import { basisOf, surfacesOf } from "./splat_kind.js";

const GREY = 0.5,
  C0 = 0.28209479177387814; // a colour is grey and the constant harmonic times its coefficient

export class MirrorKind {
  constructor(gl, shaders, { tensors, facts, normals }) {
    const { mirror, box } = facts,
      surfaces = surfacesOf(tensors, normals);
    this.surfaces = numbered(gl, "rgba32f", surfaces.length / 4, surfaces);
    this.lit = mirror.lit;
    const maps = mapsOf(gl, tensors, facts.sizes.LEVELS),
      half = Math.max(...box[1].map((high, k) => high - box[0][k])) / 2;
    this.textures = { maps: maps.texture, places: placesOf(gl, tensors, facts.sizes) };
    this.wholes = { "map_sides[0]": maps.sides, "map_rows[0]": maps.rows };
    this.numbers = {
      boxMiddle: box[0].map((low, k) => (low + box[1][k]) / 2),
      boxHalf: half,
      sphere: mirror.parallax ? Array.from(tensors.get("shader.sphere").values) : [0, 0, 0, 0],
    };
    const network = inFours(tensors, layersOf(tensors, "shader.mlp"));
    if (network.byteLength > gl.getParameter(gl.MAX_UNIFORM_BLOCK_SIZE))
      throw new Error("the network is too large for this browser");
    this.network = gl.createBuffer();
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.network);
    gl.bufferData(gl.UNIFORM_BUFFER, network, gl.STATIC_DRAW);
    const picture = [
      "numbered.glsl",
      "layers.glsl",
      "blend_head.glsl",
      "mirror_channels.glsl",
      "blend.glsl",
      "surface.glsl",
      "mirror_main.glsl",
    ];
    const sizes = { ...facts.sizes, WEIGHTS: network.length / 4 };
    this.colored = facts.sizes.BASIS ? coloredOf(gl, shaders, { tensors, facts }, surfaces) : null;
    this.program = programOf(gl, shaders, picture, sizes);
  }

  // Opacities and which way a normal looks depend on the camera too; the lists hold both. Colours are whole whatever
  // the fader says: the network sees them, and what they have of the view is faded in the picture.
  prepare(view, _, some) {
    return this.colored?.prepare(view, 1, some) ?? true;
  }

  bound(lists, camera, residual) {
    const [a, b, c, , d, e, f, , g, h, i] = camera.pose,
      { focal, center, position } = camera;
    const toWorld = [a, b, c, d, e, f, g, h, i]; // the rotation's transpose, columns first
    const colors = this.colored ? { colors: this.colored.colors } : {};
    const program = this.program.use().textures({ ...lists, surfaces: this.surfaces, ...this.textures, ...colors });
    program.wholes(this.wholes).block("Network", this.network);
    const light = this.lit ? residual : 0;
    return program.numbers({ ...this.numbers, toWorld, focal, center, position, residual, light });
  }
}

// Base colours that change with the view: the constant ones, and weights of shared harmonics.
function coloredOf(gl, shaders, { tensors, facts }, surfaces) {
  const rows = facts.gaussians,
    texels = surfaces.length / rows,
    constants = new Float32Array(4 * rows);
  for (let row = 0; row < rows; row++)
    for (let k = 0; k < 3; k++) constants[4 * row + k] = (surfaces[texels * row + k] - GREY) / C0;
  const means = inTexels(tensors.get("columns.means").values, 3);
  const textures = {
    means: numbered(gl, "rgba32f", rows, means),
    dc: numbered(gl, "rgba32f", rows, constants),
    ...basisOf(gl, tensors, "color.varying.basis"),
  };
  const recolor = programOf(gl, shaders, ["numbered.glsl", "harmonics.glsl", "harmonics_main.glsl"], facts.sizes);
  return new Colors(gl, recolor, rows, { textures, wholes: { degree: facts.degree } });
}

// Octahedral maps of several sizes below each other; where the square's edge shows one direction twice, with the mean.
function mapsOf(gl, tensors, levels) {
  const maps = Array.from({ length: levels }, (_, level) => tensors.get(`shader.maps.0.levels.${level}`));
  const sides = maps.map(({ shape }) => shape[0]),
    width = Math.max(...sides);
  const rows = sides.map((_, level) => sides.slice(0, level).reduce((sum, side) => sum + side, 0));
  const height = sides.reduce((sum, side) => sum + side, 0),
    values = new Float32Array(4 * width * height);
  maps.forEach(({ values: level }, number) => {
    const side = sides[number],
      sewn = sewnMap(level, side);
    for (let row = 0; row < side; row++) {
      values.set(sewn.subarray(4 * side * row, 4 * side * (row + 1)), 4 * width * (rows[number] + row));
    }
  });
  return { texture: new Texture(gl, "rgba32f", width, height, values), sides, rows };
}

function sewnMap(level, side) {
  const found = Float32Array.from(level),
    last = side - 1;
  const joined = (row, column, otherRow, otherColumn) => {
    for (let k = 0; k < 4; k++) {
      const one = 4 * (row * side + column) + k,
        other = 4 * (otherRow * side + otherColumn) + k;
      found[one] = found[other] = (found[one] + found[other]) / 2;
    }
  };
  for (const edge of [0, last]) for (let k = 0; k < side / 2; k++) joined(edge, k, edge, last - k);
  for (const edge of [0, last]) for (let k = 0; k < side / 2; k++) joined(k, edge, last - k, edge);
  return found;
}

// Rows are the nodes of x, then y, then z; a texel holds the four features of one level.
function placesOf(gl, tensors, { AXIS_NODES, LEVELS }) {
  const values = AXIS_NODES ? tensors.get("shader.places.axes").values : new Float32Array(4 * LEVELS);
  return new Texture(gl, "rgba32f", LEVELS, Math.max(3 * AXIS_NODES, 1), values);
}
