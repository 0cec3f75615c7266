// Opacities towards the camera; of glossy-gaussian they are harmonics of the direction, of our own methods their logits
// have harmonics of weights that are shared out. The twin of color/glossy_harmonics.py, color/basis_opacities.py and
// core/sh_basis.py.
const C1 = 0.4886025119029199,
  C2 = [0.31539156525252005, 1.0925484305920792, 0.5462742152960396],
  C3 = [0.3731763325901154, 0.4570457994644658, 1.445305721320277, 0.5900435899266435];
const LEAST_MEAN = 1e-12,
  SMALLEST_LENGTH = 1e-12;

export class Opacities {
  // `opacityRest` holds the harmonics after the constant one, as many for each Gaussian; those up to the degree count.
  // `inLogits`: they are added to the logits, not to the opacities.
  constructor({ means, opacityLogits, opacityRest, opacityDegree = 0, inLogits = false }) {
    this.mean = Float32Array.from(opacityLogits, sigmoid);
    this.logits = inLogits ? opacityLogits : null;
    this.used = (opacityDegree + 1) ** 2 - 1;
    this.shown = this.used ? new Float32Array(this.mean.length) : this.mean;
    Object.assign(this, { means, rest: opacityRest, harmonics: new Float64Array(15), position: null });
  }

  // From a camera there; made again only when its position has changed.
  towards(position) {
    if (!this.used || this.position?.join() === position.join()) return this.shown;
    const { mean, logits, means, rest, shown, harmonics, used } = this,
      [x, y, z] = position,
      stored = rest.length / mean.length;
    for (let row = 0; row < mean.length; row++) {
      harmonicsOf(means[3 * row] - x, means[3 * row + 1] - y, means[3 * row + 2] - z, harmonics);
      let sum = logits ? logits[row] : mean[row];
      for (let k = 0; k < used; k++) sum += rest[stored * row + k] * harmonics[k];
      const opacity = logits ? sigmoid(sum) : Math.min(Math.max(sum, 0), 1);
      shown[row] = opacity * Math.min(mean[row] / LEAST_MEAN, 1);
    }
    this.position = position;
    return shown;
  }
}

const sigmoid = (logit) => 1 / (1 + Math.exp(-logit));

// Those of degree 1 to 3 towards a vector of any length.
function harmonicsOf(dx, dy, dz, y) {
  const scale = 1 / Math.max(Math.sqrt(dx * dx + dy * dy + dz * dz), SMALLEST_LENGTH),
    a = dx * scale,
    b = dy * scale,
    c = dz * scale;
  const aa = a * a,
    bb = b * b,
    cc = c * c;
  y[0] = -C1 * b;
  y[1] = C1 * c;
  y[2] = -C1 * a;
  y[3] = C2[1] * a * b;
  y[4] = -C2[1] * b * c;
  y[5] = C2[0] * (2 * cc - aa - bb);
  y[6] = -C2[1] * a * c;
  y[7] = C2[2] * (aa - bb);
  y[8] = -C3[3] * b * (3 * aa - bb);
  y[9] = 2 * C3[2] * a * b * c;
  y[10] = -C3[1] * b * (4 * cc - aa - bb);
  y[11] = C3[0] * c * (2 * cc - 3 * aa - 3 * bb);
  y[12] = -C3[1] * a * (4 * cc - aa - bb);
  y[13] = C3[2] * c * (aa - bb);
  y[14] = -C3[3] * a * (aa - 3 * bb);
}
