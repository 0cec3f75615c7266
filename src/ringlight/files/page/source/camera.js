const STEEPEST = 1.55; // radians above or below the horizon that a view is turned to

// A pinhole as core/camera.py has it: x right, y down, z forward; `pose` is world to camera, three rows of four. Who
// knows the `position` gives it: computed, it would change by a rounding when the camera only turns.
export function cameraOf(pose, focal, center, size, position = positionOf(pose)) {
  return { pose, focal, center, size, position };
}

function positionOf([a, b, c, x, d, e, f, y, g, h, i, z]) {
  return [-(a * x + d * y + g * z), -(b * x + e * y + h * z), -(c * x + f * y + i * z)];
}

// The same view in a picture of another size, whole: what is missing at two sides is shown in addition.
export function fitted(camera, size) {
  const factor = Math.min(size[0] / camera.size[0], size[1] / camera.size[1]);
  const focal = camera.focal.map((value) => value * factor);
  const center = camera.center.map((value, axis) => size[axis] / 2 + (value - camera.size[axis] / 2) * factor);
  return cameraOf(camera.pose, focal, center, size, camera.position);
}

// A place to look from: `turn` are the rows right, down, forward; `reach` is how far in front the view turns about.
export class Pose {
  constructor(position, turn, reach) {
    Object.assign(this, { position: [...position], turn: turn.map((row) => [...row]), reach });
  }

  static of(camera, middle) {
    const p = camera.pose,
      turn = [
        [p[0], p[1], p[2]],
        [p[4], p[5], p[6]],
        [p[8], p[9], p[10]],
      ];
    const away = middle.map((value, k) => value - camera.position[k]),
      ahead = dot(away, turn[2]);
    return new Pose(camera.position, turn, ahead > 0 ? ahead : Math.hypot(...away) || 1);
  }

  // Of numbers that were rounded, or are anybody's.
  static near(position, turn, reach) {
    return new Pose(position, orthonormal(turn), Math.max(reach, Number.MIN_VALUE));
  }

  numbers() {
    return this.turn.flatMap((row) => [...row, -dot(row, this.position)]);
  }

  get target() {
    return this.position.map((value, k) => value + this.reach * this.turn[2][k]);
  }

  // Turn by angles, radians, to the right about `up` and upwards about the own right side; about the target, or about
  // the camera itself. Who stands upright does not fall over at the poles.
  turned(right, upwards, up, aboutTarget) {
    const target = this.target,
      spin = rotationAbout(up, right),
      turn = this.turn.map((row) => times(spin, row));
    const lift = Math.asin(Math.min(Math.max(dot(turn[2], up), -1), 1)),
      upright = dot(turn[1], up) < 0;
    const least = Math.min(-STEEPEST - lift, 0),
      most = Math.max(STEEPEST - lift, 0);
    const kept = upright ? Math.min(Math.max(upwards, least), most) : upwards;
    const tilt = rotationAbout(turn[0], kept);
    const found = orthonormal(turn.map((row) => times(tilt, row)));
    const position = aboutTarget ? target.map((value, k) => value - this.reach * found[2][k]) : this.position;
    return new Pose(position, found, this.reach);
  }

  // Moved along the own axes, world units.
  moved(right, down, forward) {
    const [x, y, z] = this.turn;
    return new Pose(
      this.position.map((p, k) => p + right * x[k] + down * y[k] + forward * z[k]),
      this.turn,
      this.reach,
    );
  }

  // Nearer to the target by a factor below one, which stays where it is.
  nearer(factor) {
    const target = this.target,
      reach = this.reach * factor;
    return new Pose(
      target.map((value, k) => value - reach * this.turn[2][k]),
      this.turn,
      reach,
    );
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const times = (matrix, v) => matrix.map((row) => dot(row, v));

function rotationAbout([x, y, z], angle) {
  const c = Math.cos(angle),
    s = Math.sin(angle),
    t = 1 - c;
  return [
    [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
    [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
    [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
  ];
}

function orthonormal([right, , forward]) {
  const ahead = scaled(forward),
    down = scaled(cross(ahead, right));
  return [cross(down, ahead), down, ahead];
}

function scaled(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((value) => value / length);
}
