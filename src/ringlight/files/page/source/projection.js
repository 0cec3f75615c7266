// Gaussians to ellipses on the picture; the twin of rasterize/projection.py, with its constants.
import { rotation } from "./axes.js";
import { Opacities } from "./opacities.js";

const EPS2D = 0.3,
  NEAR = 0.01,
  FRUSTUM_MARGIN = 0.3,
  MIN_ALPHA = 1 / 255;

// Floats of one ellipse: centre x, y, opacity, 1 + its row (negative where its normal is turned round), the inverse
// covariance xx, xy, yy, and depth. The picture's shader reads them as two texels.
export const ELLIPSE = 8;

// What does not depend on the camera. `axes` are the principal axes times their deviations, nine floats a row.
export function preparedScene(geometry) {
  const { means, logScales, quats, normals } = geometry,
    count = means.length / 3,
    axes = new Float32Array(9 * count);
  for (let row = 0; row < count; row++) {
    const turn = rotation(quats.subarray(4 * row, 4 * row + 4));
    for (let k = 0; k < 9; k++) axes[9 * row + k] = turn[k] * Math.exp(logScales[3 * row + (k % 3)]);
  }
  return { count, means, axes, opacities: new Opacities(geometry), normals };
}

export class Projection {
  constructor(scene, { antialiased, flipBelow }) {
    Object.assign(this, { scene, antialiased, flipBelow });
    this.ellipses = new Float32Array(ELLIPSE * scene.count);
    this.depths = new Float32Array(scene.count);
    this.count = 0;
  }

  // Fill `ellipses` and `depths` with what the camera may see, in the order of the table.
  project(camera) {
    const { means, axes, count } = this.scene,
      opacities = this.scene.opacities.towards(camera.position),
      { pose, focal, center, size } = camera;
    const [a, b, c, tx, d, e, f, ty, g, h, i, tz] = pose,
      ellipses = this.ellipses;
    const [lowX, highX] = slopes(0, camera),
      [lowY, highY] = slopes(1, camera);
    let seen = 0;
    for (let row = 0; row < count; row++) {
      const opacity = opacities[row],
        x = means[3 * row],
        y = means[3 * row + 1],
        z = means[3 * row + 2];
      const depth = g * x + h * y + i * z + tz;
      if (!(depth >= NEAR) || opacity < MIN_ALPHA) continue;
      const slopeX = (a * x + b * y + c * z + tx) / depth,
        slopeY = (d * x + e * y + f * z + ty) / depth;
      const centerX = focal[0] * slopeX + center[0],
        centerY = focal[1] * slopeY + center[1];
      const byX = focal[0] / depth,
        byY = focal[1] / depth;
      const sx = slopeX < lowX ? lowX : slopeX > highX ? highX : slopeX;
      const sy = slopeY < lowY ? lowY : slopeY > highY ? highY : slopeY;
      const ux = byX * (a - sx * g),
        uy = byX * (b - sx * h),
        uz = byX * (c - sx * i);
      const vx = byY * (d - sy * g),
        vy = byY * (e - sy * h),
        vz = byY * (f - sy * i);
      let xx = 0,
        xy = 0,
        yy = 0;
      for (let k = 9 * row; k < 9 * row + 3; k++) {
        const p = ux * axes[k] + uy * axes[k + 3] + uz * axes[k + 6];
        const q = vx * axes[k] + vy * axes[k + 3] + vz * axes[k + 6];
        xx += p * p;
        xy += p * q;
        yy += q * q;
      }
      const sharp = xx * yy - xy * xy;
      xx += EPS2D;
      yy += EPS2D;
      const determinant = xx * yy - xy * xy;
      const shown = this.antialiased ? opacity * Math.sqrt(Math.max(sharp / determinant, 0)) : opacity;
      if (!(shown >= MIN_ALPHA && determinant > 0 && determinant < Infinity)) continue;
      const reach = 2 * Math.log(shown / MIN_ALPHA),
        wide = Math.sqrt(reach * xx),
        high = Math.sqrt(reach * yy);
      if (!(centerX + wide > 0 && centerX - wide < size[0] && centerY + high > 0 && centerY - high < size[1])) continue;
      const at = ELLIPSE * seen;
      ellipses[at] = centerX;
      ellipses[at + 1] = centerY;
      ellipses[at + 2] = shown;
      ellipses[at + 3] = this.faces(row, camera.position) ? row + 1 : -row - 1;
      ellipses[at + 4] = yy / determinant;
      ellipses[at + 5] = -xy / determinant;
      ellipses[at + 6] = xx / determinant;
      ellipses[at + 7] = this.depths[seen] = depth;
      seen++;
    }
    this.count = seen;
  }

  faces(row, [x, y, z]) {
    const { means, normals } = this.scene,
      k = 3 * row;
    const dx = x - means[k],
      dy = y - means[k + 1],
      dz = z - means[k + 2];
    const along = dx * normals[k] + dy * normals[k + 1] + dz * normals[k + 2];
    return along >= this.flipBelow * Math.sqrt(dx * dx + dy * dy + dz * dz);
  }
}

// The range of x/z or y/z in which the affine approximation is taken.
function slopes(axis, { focal, center, size }) {
  const margin = (FRUSTUM_MARGIN * 0.5 * size[axis]) / focal[axis];
  return [-(center[axis] / focal[axis] + margin), (size[axis] - center[axis]) / focal[axis] + margin];
}
