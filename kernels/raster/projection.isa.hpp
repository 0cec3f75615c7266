// Sixteen Gaussians from the table to ellipses on the image, with all that the gradient needs on the way back.
// Zwicker et al. 2001, EWA volume splatting; the frustum clamp and the low-pass filter are gsplat's.
//
// Differences of two products name their fma: the compiler might fuse either product, and not the same one in both
// halves of an AVX2 register, so that a Gaussian's bits would depend on its row.
#pragma once
#include "raster/raster.hpp"
#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {

constexpr float TWO_LN2 = 1.38629436111989f;  // squared standard deviations per power of two of alpha

// Sixteen rows of the table; rows past its end are copies of its last row. Channels too many for a record stay away.
struct SplatRows {
  const float *means, *log_scales, *quats, *opacity_logits, *opacity_factor, *channels;
  int record_channels;
  float padding[LANES * (12 + RECORD_CHANNELS)];
};

RINGLIGHT_INLINE const float* pad_rows(const float* from, int width, int count, float*& free) {
  float* const rows = free;
  for (int i = 0; i < LANES; i++)
    for (int k = 0; k < width; k++) rows[i * width + k] = from[(i < count ? i : count - 1) * width + k];
  free += LANES * width;
  return rows;
}

RINGLIGHT_INLINE void take_rows(const Splats& splats, std::size_t first, int count, SplatRows& rows) {
  rows.means = splats.means + 3 * first;
  rows.log_scales = splats.log_scales + 3 * first;
  rows.quats = splats.quats + 4 * first;
  rows.opacity_logits = splats.opacity_logits + first;
  rows.opacity_factor = splats.opacity_factor ? splats.opacity_factor + first : nullptr;
  rows.record_channels = splats.channel_count <= RECORD_CHANNELS ? splats.channel_count : 0;
  rows.channels = splats.channels + first * static_cast<std::size_t>(splats.channel_count);
  if (count == LANES) return;
  float* free = rows.padding;
  rows.means = pad_rows(rows.means, 3, count, free);
  rows.log_scales = pad_rows(rows.log_scales, 3, count, free);
  rows.quats = pad_rows(rows.quats, 4, count, free);
  rows.opacity_logits = pad_rows(rows.opacity_logits, 1, count, free);
  if (rows.opacity_factor) rows.opacity_factor = pad_rows(rows.opacity_factor, 1, count, free);
  if (rows.record_channels) rows.channels = pad_rows(rows.channels, rows.record_channels, count, free);
}

struct Projection {
  Vec position[3];       // in camera coordinates
  Vec inverse_z;
  Vec slope[2];          // x / z, y / z
  Vec clamped[2];        // the same, kept near the image: the affine approximation explodes far outside
  Vec unit_quat[4];
  Vec inverse_norm[2];   // 1 / |quat| as two factors, either of which may be extreme
  Vec rotation[9];       // row-major
  Vec scale[3];
  Vec axes[9];           // world_to_camera rotation scale; columns are the principal axes in camera coordinates
  Vec half_x[3], half_y[3];  // rows of the 2 x 3 matrix H with covariance H H^T, pixels
  Vec cov_xx, cov_xy, cov_yy;  // with the low-pass filter
  Vec normal[3];         // half_x cross half_y
  Vec det, det_sharp;    // determinant of the covariance with and without the filter
  Vec sigmoid, one_minus_sigmoid, factor, compensation;
  Vec opacity;           // sigmoid factor compensation
};

struct SlopeLimits {
  float low_x, high_x, low_y, high_y;
};

RINGLIGHT_INLINE SlopeLimits slope_limits(const Camera& camera) {
  const float w = static_cast<float>(camera.width), h = static_cast<float>(camera.height);
  const float margin_x = convention::FRUSTUM_MARGIN * 0.5f * w / camera.focal_x;
  const float margin_y = convention::FRUSTUM_MARGIN * 0.5f * h / camera.focal_y;
  return {-camera.center_x / camera.focal_x - margin_x, (w - camera.center_x) / camera.focal_x + margin_x,
          -camera.center_y / camera.focal_y - margin_y, (h - camera.center_y) / camera.focal_y + margin_y};
}

// One row of world_to_camera times a column of three.
RINGLIGHT_INLINE Vec rotate_row(const float* row, Vec a, Vec b, Vec c) {
  return fma(Vec(row[0]), a, fma(Vec(row[1]), b, Vec(row[2]) * c));
}

RINGLIGHT_INLINE void place(const Camera& camera, const float* means, Projection& p) {
  constexpr float SMALLEST_Z = 1e-6f;  // rows that near are culled; this only keeps their lanes finite
  Vec x, y, z;
  load_columns(means, x, y, z);
  for (int k = 0; k < 3; k++) {
    const float* row = camera.world_to_camera + 4 * k;
    p.position[k] = fma(Vec(row[0]), x, fma(Vec(row[1]), y, fma(Vec(row[2]), z, Vec(row[3]))));
  }
  p.inverse_z = Vec(1.f) / max(p.position[2], Vec(SMALLEST_Z));
  const SlopeLimits limits = slope_limits(camera);
  p.slope[0] = p.position[0] * p.inverse_z;
  p.slope[1] = p.position[1] * p.inverse_z;
  p.clamped[0] = min(max(p.slope[0], Vec(limits.low_x)), Vec(limits.high_x));
  p.clamped[1] = min(max(p.slope[1], Vec(limits.low_y)), Vec(limits.high_y));
}

RINGLIGHT_INLINE void rotate(const float* quats, Projection& p) {
  constexpr float SMALLEST_LENGTH = 1e-37f;  // below: taken as the zero quaternion, which rotates by nothing
  Vec w, x, y, z;
  load_columns(quats, w, x, y, z);
  // Divided by the largest component first: squares of 1e-30 or 1e30 are not numbers of this type.
  const Vec largest = max(max(max(abs(w), abs(x)), max(abs(y), abs(z))), Vec(SMALLEST_LENGTH));
  const Vec inverse_largest = Vec(1.f) / largest;
  w = w * inverse_largest, x = x * inverse_largest, y = y * inverse_largest, z = z * inverse_largest;
  const Vec square = fma(w, w, fma(x, x, fma(y, y, z * z)));
  const Vec inverse_length = Vec(1.f) / sqrt(max(square, Vec(0.5f)));  // the square is at least 1, or 0
  p.inverse_norm[0] = inverse_largest, p.inverse_norm[1] = inverse_length;
  w = w * inverse_length, x = x * inverse_length, y = y * inverse_length, z = z * inverse_length;
  p.unit_quat[0] = w, p.unit_quat[1] = x, p.unit_quat[2] = y, p.unit_quat[3] = z;
  const Vec two(2.f), one(1.f);
  p.rotation[0] = fnma(two, fma(y, y, z * z), one);
  p.rotation[1] = two * fnma(w, z, x * y);
  p.rotation[2] = two * fma(w, y, x * z);
  p.rotation[3] = two * fma(w, z, x * y);
  p.rotation[4] = fnma(two, fma(x, x, z * z), one);
  p.rotation[5] = two * fnma(w, x, y * z);
  p.rotation[6] = two * fnma(w, y, x * z);
  p.rotation[7] = two * fma(w, x, y * z);
  p.rotation[8] = fnma(two, fma(x, x, y * y), one);
}

RINGLIGHT_INLINE void cross(const Vec* a, const Vec* b, Vec* to) {
  to[0] = fnma(a[2], b[1], a[1] * b[2]);
  to[1] = fnma(a[0], b[2], a[2] * b[0]);
  to[2] = fnma(a[1], b[0], a[0] * b[1]);
}

RINGLIGHT_INLINE void cover(const Camera& camera, float eps2d, const float* log_scales, Projection& p) {
  load_columns(log_scales, p.scale[0], p.scale[1], p.scale[2]);
  for (int j = 0; j < 3; j++) p.scale[j] = exp(p.scale[j]);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      p.axes[3 * i + j] =
          rotate_row(camera.world_to_camera + 4 * i, p.rotation[j], p.rotation[3 + j], p.rotation[6 + j]) * p.scale[j];
  const Vec zoom_x = Vec(camera.focal_x) * p.inverse_z, zoom_y = Vec(camera.focal_y) * p.inverse_z;
  for (int j = 0; j < 3; j++) {
    p.half_x[j] = zoom_x * fnma(p.clamped[0], p.axes[6 + j], p.axes[j]);
    p.half_y[j] = zoom_y * fnma(p.clamped[1], p.axes[6 + j], p.axes[3 + j]);
  }
  const Vec* const x = p.half_x;
  const Vec* const y = p.half_y;
  const Vec xx = fma(x[0], x[0], fma(x[1], x[1], x[2] * x[2]));
  const Vec yy = fma(y[0], y[0], fma(y[1], y[1], y[2] * y[2]));
  p.cov_xy = fma(x[0], y[0], fma(x[1], y[1], x[2] * y[2]));
  p.cov_xx = xx + Vec(eps2d);
  p.cov_yy = yy + Vec(eps2d);
  // Lagrange's identity, |x|^2 |y|^2 - (x y)^2 = |x cross y|^2: needles keep their determinant, it is never negative.
  cross(x, y, p.normal);
  p.det_sharp = fma(p.normal[0], p.normal[0], fma(p.normal[1], p.normal[1], p.normal[2] * p.normal[2]));
  p.det = fma(Vec(eps2d), xx + p.cov_yy, p.det_sharp);
}

RINGLIGHT_INLINE void weigh(const RasterSettings& settings, const SplatRows& rows, Projection& p) {
  const Vec odds_against = exp(-load(rows.opacity_logits));
  p.sigmoid = Vec(1.f) / (Vec(1.f) + odds_against);
  p.one_minus_sigmoid = odds_against * p.sigmoid;  // the difference would lose the digits of opaque splats
  p.factor = rows.opacity_factor ? load(rows.opacity_factor) : Vec(1.f);
  p.compensation = settings.antialiased ? sqrt(p.det_sharp / p.det) : Vec(1.f);
  p.opacity = p.sigmoid * p.factor * p.compensation;
}

RINGLIGHT_INLINE void project_rows(const View& view, const SplatRows& rows, Projection& p) {
  place(view.camera, rows.means, p);
  rotate(rows.quats, p);
  cover(view.camera, view.settings.eps2d, rows.log_scales, p);
  weigh(view.settings, rows, p);
}

}  // namespace ringlight::RINGLIGHT_ISA
