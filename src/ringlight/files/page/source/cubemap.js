// Six faces, each with the texels around it, below each other; twin of bordered() in fields/cubemap.py.
import { Texture } from "./gl.js";

const FACES = 6,
  OTHERS = [
    [1, 2],
    [0, 2],
    [0, 1],
  ]; // axes along a face's columns and rows, by the axis that it lies across

// `colors` [6, S, S, 3] to a texture of S + 2 columns and 6 (S + 2) rows.
export function cubemapTexture(gl, colors, side) {
  return new Texture(gl, "rgba32f", side + 2, FACES * (side + 2), borderedFaces(colors, side));
}

// `colors` [6, S, S, 3] to texels of four numbers [6, S + 2, S + 2].
export function borderedFaces(colors, side) {
  const wide = side + 2,
    values = new Float32Array(4 * wide * wide * FACES);
  for (let face = 0; face < FACES; face++) {
    for (let row = -1; row <= side; row++) {
      for (let column = -1; column <= side; column++) {
        const to = 4 * ((face * wide + row + 1) * wide + column + 1),
          texels = texelsAt(face, row, column, side);
        for (const texel of texels)
          for (let k = 0; k < 3; k++) values[to + k] += colors[3 * texel + k] / texels.length;
      }
    }
  }
  return values;
}

// The texel at a place of a face; beyond an edge that of the face which meets there, beyond a corner of all three.
function texelsAt(face, row, column, side) {
  const axis = face >> 1,
    last = side - 1,
    [across, down] = OTHERS[axis],
    at = [0, 0, 0];
  at[axis] = face % 2 ? 0 : last;
  at[across] = column;
  at[down] = row;
  const inside = at.map((number) => Math.min(Math.max(number, 0), last));
  const beyond = [across, down].filter((other) => at[other] !== inside[other]);
  const faces = beyond.map((other) => 2 * other + (at[other] > 0 ? 0 : 1));
  if (beyond.length !== 1) faces.push(face);
  return faces.map((number) => texel(number, inside, side));
}

function texel(face, at, side) {
  const [across, down] = OTHERS[face >> 1];
  return (face * side + at[down]) * side + at[across];
}
