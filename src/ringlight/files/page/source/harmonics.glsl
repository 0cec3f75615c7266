// Harmonics of each Gaussian towards where the camera is; the twin of core/sh_basis.py and of color/shared_basis.py.
uniform sampler2D means, dc;
uniform vec3 position;
uniform float residual;
uniform usampler2D wanted;
uniform int degree;
layout(location = 0) out uvec4 color;

const float C0 = 0.28209479177387814, C1 = 0.4886025119029199;
const vec3 C2 = vec3(0.31539156525252005, 1.0925484305920792, 0.5462742152960396);
const vec4 C3 = vec4(0.3731763325901154, 0.4570457994644658, 1.445305721320277, 0.5900435899266435);

#if BASIS > 0
uniform sampler2D weights, basis;
#else
uniform usampler2D codes;
uniform sampler2D scales;
#endif

void harmonics(vec3 v, out float y[15]) {
  float xx = v.x * v.x, yy = v.y * v.y, zz = v.z * v.z;
  y[0] = -C1 * v.y; y[1] = C1 * v.z; y[2] = -C1 * v.x;
  y[3] = C2.y * v.x * v.y; y[4] = -C2.y * v.y * v.z; y[5] = C2.x * (2.0 * zz - xx - yy);
  y[6] = -C2.y * v.x * v.z; y[7] = C2.z * (xx - yy);
  y[8] = -C3.w * v.y * (3.0 * xx - yy); y[9] = 2.0 * C3.z * v.x * v.y * v.z;
  y[10] = -C3.y * v.y * (4.0 * zz - xx - yy); y[11] = C3.x * v.z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
  y[12] = -C3.y * v.x * (4.0 * zz - xx - yy); y[13] = C3.z * v.z * (xx - yy); y[14] = -C3.w * v.x * (xx - 3.0 * yy);
}

vec3 seen(int row, vec3 v) {
  float y[15];
  harmonics(v, y);
  int used = (degree + 1) * (degree + 1) - 1;
  vec3 sum = vec3(0.0);
#if BASIS > 0
  for (int k = 0; k < BASIS; k++) {
    float weight = numbered(weights, row * ((BASIS + 3) / 4) + k / 4)[k % 4];
    for (int j = 0; j < used; j++) sum += weight * y[j] * numbered(basis, 15 * k + j).xyz;
  }
#elif STORED > 0
  // Bytes over each coefficient's range, as the file has them; red, green and blue of a harmonic follow each other.
  for (int j = 0; j < min(used, STORED); j++) {
    for (int c = 0; c < 3; c++) {
      int at = 3 * j + c;
      float code = float(texelFetch(codes, placed(row * ((3 * STORED + 3) / 4) + at / 4), 0)[at % 4]);
      vec4 scale = numbered(scales, at);
      sum[c] += y[j] * (scale.x + scale.y * code);
    }
  }
#endif
  return sum;
}
