// Principal axes of Gaussians.

// Row by row; columns are the principal axes.
export function rotation(quat) {
  const length = Math.hypot(...quat) || 1,
    [w, x, y, z] = Array.from(quat, (value) => value / length);
  return [
    1 - 2 * (y * y + z * z),
    2 * (x * y - w * z),
    2 * (x * z + w * y),
    2 * (x * y + w * z),
    1 - 2 * (x * x + z * z),
    2 * (y * z - w * x),
    2 * (x * z - w * y),
    2 * (y * z + w * x),
    1 - 2 * (x * x + y * y),
  ];
}

// The usual stand-in for a normal, where a model has none.
export function shortestAxes(logScales, quats) {
  const count = quats.length / 4,
    normals = new Float32Array(3 * count);
  for (let row = 0; row < count; row++) {
    const scales = logScales.subarray(3 * row, 3 * row + 3),
      shortest = scales.indexOf(Math.min(...scales));
    const turn = rotation(quats.subarray(4 * row, 4 * row + 4));
    for (let k = 0; k < 3; k++) normals[3 * row + k] = turn[3 * k + shortest];
  }
  return normals;
}
