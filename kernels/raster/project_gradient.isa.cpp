// Stage 6: sums over pixels to gradients of the stored parameters. The projection is computed again: cheaper than to
// keep its fifty values per Gaussian.
#include "machine/parallel.hpp"
#include "raster/projection.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

// Slots count in u and v of log2(alpha) = ... - u^2 - v^2; d^T Q d / 2 is u^2 + v^2 times this / 2.
constexpr float SQRT_TWO_LN2 = 1.17741002251547f;

// Slots of one Gaussian: the entries of its placement, side by side.
struct SlotRange {
  std::size_t begin, end;
};

RINGLIGHT_INLINE SlotRange slots_of(const View& view, const Piece& piece, std::size_t row) {
  const Placement& place = view.placements[row];
  unsigned slots = static_cast<unsigned>(__builtin_popcount(place.tiles & ~LISTED));
  if (place.tiles == EVERY_TILE) slots = (place.x1 - place.x0 + 1u) * (place.y1 - place.y0 + 1u);
  const std::size_t begin = piece.first_slot + place.first_slot;
  return {begin, begin + slots};
}

// Adds up the first LANES floats of the slots of sixteen Gaussians, each in the order of its tiles: one Vec each.
// Returns a bit per Gaussian that has any.
RINGLIGHT_INLINE unsigned add_slots(const View& view, std::size_t first, int count, std::size_t stride, Vec* totals) {
  const Piece& piece = view.pieces[first / ROWS_PER_PIECE];
  unsigned seen = 0;
  for (int i = 0; i < LANES; i++) {
    Vec total(0.f);
    if (i < count) {
      const SlotRange range = slots_of(view, piece, first + static_cast<std::size_t>(i));
      for (std::size_t slot = range.begin; slot < range.end; slot++) {
        if (!view.slot_used[slot]) continue;
        seen |= 1u << i;
        total += load(view.slots + slot * stride);
      }
    }
    totals[i] = total;
  }
  return seen;
}

// Channel gradients of one Gaussian, straight to its row, where not all lie in the first LANES floats of a slot.
RINGLIGHT_INLINE void add_channels(const View& view, std::size_t row, std::size_t stride, bool seen, float* to) {
  const SlotRange range = slots_of(view, view.pieces[row / ROWS_PER_PIECE], row);
  const float* const from = view.slots + slot_moments(view.settings.absgrad);
  const int channels = view.gradient_channels;
  for (int c = 0; c < channels; c += LANES) {
    const int width = channels - c < LANES ? channels - c : LANES;
    Vec total(0.f);
    for (std::size_t slot = range.begin; seen && slot < range.end; slot++)
      if (view.slot_used[slot]) total += load_first(from + slot * stride + c, width);
    store_first(to + c, total, width);
  }
}

// Channel gradients of sixteen Gaussians row by row; `totals` as add_slots left them.
RINGLIGHT_INLINE void write_channel_rows(const View& view, float* to, std::size_t first, int count,
                                         std::size_t stride, unsigned seen, const Vec* totals) {
  const int channels = view.gradient_channels, moments = slot_moments(view.settings.absgrad);
  for (int i = 0; i < count; i++) {
    const std::size_t row = first + static_cast<std::size_t>(i);
    float* const out = to + row * static_cast<std::size_t>(view.splats.channel_count);
    for (int c = channels; c < view.splats.channel_count; c++) out[c] = 0;
    if (moments + channels > LANES) {
      add_channels(view, row, stride, seen >> i & 1, out);
      continue;
    }
    float sums[LANES];
    store(sums, totals[i]);
    store_first(out, load_first(sums + moments, channels), channels);
  }
}

struct Moments {
  Vec g, u, v, uu, uv, vv, absolute_x, absolute_y;
};

// Gradients of the stored parameters of sixteen Gaussians.
struct RowGradients {
  Vec means[3], log_scales[3], quats[4], logit, factor, center[2], absolute[2];
};

// Factor L of the inverse covariance Q = L L^T, lower triangle: (u, v) = L^T d up to sqrt(2 ln 2).
struct Factor {
  Vec xx, yx, yy;
};

RINGLIGHT_INLINE Factor inverse_factor(const Projection& p) {
  const Vec inverse_yy = Vec(1.f) / p.cov_yy, xx = sqrt(p.cov_yy / p.det);
  return {xx, -(p.cov_xy * inverse_yy * xx), sqrt(inverse_yy)};
}

// dL / dH for the 2 x 3 matrix H with covariance S = H H^T. From log(alpha) = -d^T Q d / 2 follows dL/dS = Q M Q / 2
// with M the second moments of d, and dL/dH = Q M Q H = L (L^T M L) (L^T H): the middle is what the slots hold.
RINGLIGHT_INLINE void half_gradient(const Projection& p, const Factor& l, const Moments& m, bool antialiased,
                                    Vec* to_half_x, Vec* to_half_y) {
  Vec sharp_x[3], sharp_y[3], share(0.f);
  if (antialiased) {
    // log(compensation) = (log det_sharp - log det) / 2, and d log det = Q dS: that of the sharp ellipse is
    // (half_y cross normal, normal cross half_x) / det_sharp, which is at least det / 255^2 where anything is drawn.
    cross(p.half_y, p.normal, sharp_x);
    cross(p.normal, p.half_x, sharp_y);
    share = keep(gt(p.det_sharp, Vec(0.f)), m.g / p.det_sharp);
  }
  const Vec uu = Vec(TWO_LN2) * m.uu - (antialiased ? m.g : Vec(0.f)), uv = Vec(TWO_LN2) * m.uv;
  const Vec vv = Vec(TWO_LN2) * m.vv - (antialiased ? m.g : Vec(0.f));
  for (int j = 0; j < 3; j++) {
    const Vec u = fma(l.xx, p.half_x[j], l.yx * p.half_y[j]), v = l.yy * p.half_y[j];
    const Vec to_u = fma(uu, u, uv * v), to_v = fma(uv, u, vv * v);
    to_half_x[j] = l.xx * to_u;
    to_half_y[j] = fma(l.yx, to_u, l.yy * to_v);
    if (!antialiased) continue;
    to_half_x[j] = fma(share, sharp_x[j], to_half_x[j]);
    to_half_y[j] = fma(share, sharp_y[j], to_half_y[j]);
  }
}

RINGLIGHT_INLINE void quat_gradient(const Projection& p, const Vec* r, Vec* to) {
  const Vec w = p.unit_quat[0], x = p.unit_quat[1], y = p.unit_quat[2], z = p.unit_quat[3], two(2.f);
  const Vec vw = two * (x * (r[7] - r[5]) + y * (r[2] - r[6]) + z * (r[3] - r[1]));
  const Vec vx = two * (y * (r[1] + r[3]) + z * (r[2] + r[6]) + w * (r[7] - r[5]) - two * x * (r[4] + r[8]));
  const Vec vy = two * (x * (r[1] + r[3]) + z * (r[5] + r[7]) + w * (r[2] - r[6]) - two * y * (r[0] + r[8]));
  const Vec vz = two * (x * (r[2] + r[6]) + y * (r[5] + r[7]) + w * (r[3] - r[1]) - two * z * (r[0] + r[4]));
  // Through the normalisation: only the part across the quaternion counts.
  const Vec along = vw * w + vx * x + vy * y + vz * z;
  to[0] = fnma(along, w, vw) * p.inverse_norm[1] * p.inverse_norm[0];
  to[1] = fnma(along, x, vx) * p.inverse_norm[1] * p.inverse_norm[0];
  to[2] = fnma(along, y, vy) * p.inverse_norm[1] * p.inverse_norm[0];
  to[3] = fnma(along, z, vz) * p.inverse_norm[1] * p.inverse_norm[0];
}

// From the matrix H to the principal axes and the position, both in camera coordinates.
RINGLIGHT_INLINE void axes_gradient(const Camera& camera, const Projection& p, const Vec* half_x, const Vec* half_y,
                                    const Vec* center, Vec* to_axes, Vec* to_position) {
  const Vec fx(camera.focal_x), fy(camera.focal_y);
  const Vec zoom_x = fx * p.inverse_z, zoom_y = fy * p.inverse_z;
  Vec to_slope[2] = {Vec(0.f), Vec(0.f)}, to_inverse_z(0.f);
  for (int j = 0; j < 3; j++) {
    const Vec across_x = fnma(p.clamped[0], p.axes[6 + j], p.axes[j]);
    const Vec across_y = fnma(p.clamped[1], p.axes[6 + j], p.axes[3 + j]);
    to_inverse_z = fma(fx * across_x, half_x[j], fma(fy * across_y, half_y[j], to_inverse_z));
    const Vec ax = zoom_x * half_x[j], ay = zoom_y * half_y[j];
    to_axes[j] = ax;
    to_axes[3 + j] = ay;
    to_axes[6 + j] = -fma(p.clamped[0], ax, p.clamped[1] * ay);
    to_slope[0] = fnma(p.axes[6 + j], ax, to_slope[0]);
    to_slope[1] = fnma(p.axes[6 + j], ay, to_slope[1]);
  }
  const SlopeLimits limits = slope_limits(camera);
  const Mask free_x = both(ge(p.slope[0], Vec(limits.low_x)), ge(Vec(limits.high_x), p.slope[0]));
  const Mask free_y = both(ge(p.slope[1], Vec(limits.low_y)), ge(Vec(limits.high_y), p.slope[1]));
  const Vec sx = fma(fx, center[0], keep(free_x, to_slope[0])), sy = fma(fy, center[1], keep(free_y, to_slope[1]));
  to_position[0] = sx * p.inverse_z;
  to_position[1] = sy * p.inverse_z;
  to_inverse_z = fma(sx, p.position[0], fma(sy, p.position[1], to_inverse_z));
  to_position[2] = -(p.inverse_z * p.inverse_z * to_inverse_z);
}

RINGLIGHT_INLINE void row_gradients(const View& view, const Projection& p, const Moments& m, RowGradients& to) {
  const Factor l = inverse_factor(p);
  const Vec scale(SQRT_TWO_LN2), u = scale * m.u, v = scale * m.v;
  to.center[0] = l.xx * u;
  to.center[1] = fma(l.yx, u, l.yy * v);
  to.absolute[0] = scale * l.xx * m.absolute_x;
  to.absolute[1] = Vec(TWO_LN2) * m.absolute_y;  // along_y and across_y carry the other half of the units
  to.logit = m.g * p.one_minus_sigmoid;
  to.factor = m.g / p.factor;

  Vec half_x[3], half_y[3], to_axes[9], to_position[3], to_rotation[9];
  half_gradient(p, l, m, view.settings.antialiased, half_x, half_y);
  axes_gradient(view.camera, p, half_x, half_y, to.center, to_axes, to_position);
  const float* const w = view.camera.world_to_camera;
  for (int k = 0; k < 3; k++)
    to.means[k] = fma(Vec(w[k]), to_position[0], fma(Vec(w[4 + k]), to_position[1], Vec(w[8 + k]) * to_position[2]));
  for (int j = 0; j < 3; j++) {
    Vec to_scale(0.f);
    for (int k = 0; k < 3; k++) {
      const Vec turned = fma(Vec(w[k]), to_axes[j], fma(Vec(w[4 + k]), to_axes[3 + j], Vec(w[8 + k]) * to_axes[6 + j]));
      to_scale = fma(turned, p.rotation[3 * k + j], to_scale);
      to_rotation[3 * k + j] = turned * p.scale[j];
    }
    to.log_scales[j] = to_scale * p.scale[j];
  }
  quat_gradient(p, to_rotation, to.quats);
}

// Columns to `count` rows of memory; lanes that are off become 0.
template <int Width>
RINGLIGHT_INLINE void write_columns(float* to, std::size_t first, int count, Mask on, const Vec* columns) {
  float rows[LANES * Width];
  float* const out = count == LANES ? to + Width * first : rows;
  if constexpr (Width == 1) store(out, keep(on, columns[0]));
  if constexpr (Width == 2) store_columns(out, keep(on, columns[0]), keep(on, columns[1]));
  if constexpr (Width == 3) store_columns(out, keep(on, columns[0]), keep(on, columns[1]), keep(on, columns[2]));
  if constexpr (Width == 4)
    store_columns(out, keep(on, columns[0]), keep(on, columns[1]), keep(on, columns[2]), keep(on, columns[3]));
  if (out == rows)
    for (int i = 0; i < count * Width; i++) to[Width * first + i] = rows[i];
}

RINGLIGHT_INLINE void write_rows(const SplatGradients& to, std::size_t first, int count, Mask on,
                                 const RowGradients& from) {
  write_columns<3>(to.means, first, count, on, from.means);
  write_columns<3>(to.log_scales, first, count, on, from.log_scales);
  write_columns<4>(to.quats, first, count, on, from.quats);
  write_columns<1>(to.opacity_logits, first, count, on, &from.logit);
  write_columns<2>(to.means2d, first, count, on, from.center);
  if (to.opacity_factor) write_columns<1>(to.opacity_factor, first, count, on, &from.factor);
  if (to.absolute) write_columns<2>(to.absolute, first, count, on, from.absolute);
}

constexpr bool columns_fit(int channels) { return channels == 1 || channels == 3 || channels == 4; }

RINGLIGHT_INLINE void write_channel_columns(float* to, int channels, std::size_t first, int count, const Vec* columns) {
  const Mask all = mask_from_bits(0xffff);
  if (channels == 1) write_columns<1>(to, first, count, all, columns);
  if (channels == 3) write_columns<3>(to, first, count, all, columns);
  if (channels == 4) write_columns<4>(to, first, count, all, columns);
}

void piece_gradient(const View& view, const SplatGradients& to, std::size_t begin, std::size_t end) {
  const bool absgrad = view.settings.absgrad;
  const int channels = view.splats.channel_count;
  const std::size_t stride = static_cast<std::size_t>(slot_stride(view.gradient_channels, absgrad));
  for (std::size_t first = begin; first < end; first += LANES) {
    const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
    Vec t[LANES];
    const unsigned seen = add_slots(view, first, count, stride, t);
    if (!columns_fit(channels)) write_channel_rows(view, to.channels, first, count, stride, seen, t);
    RowGradients rows = {};
    if (seen) {
      transpose(t);
      SplatRows table;
      take_rows(view.splats, first, count, table);
      Projection p;
      project_rows(view, table, p);
      const Moments m{t[SUM_G],   t[SUM_GU],  t[SUM_GV],     t[SUM_GUU],
                      t[SUM_GUV], t[SUM_GVV], t[ABSOLUTE_X], t[ABSOLUTE_Y]};
      row_gradients(view, p, m, rows);
    }
    write_rows(to, first, count, mask_from_bits(seen), rows);
    if (columns_fit(channels))
      write_channel_columns(to.channels, channels, first, count, t + slot_moments(absgrad));
  }
}

}  // namespace

void project_gradient(const View& view, const SplatGradients& to) {
  parallel_ranges(view.splats.count, ROWS_PER_PIECE,
                  [&](std::size_t begin, std::size_t end) { piece_gradient(view, to, begin, end); });
}

}  // namespace ringlight::RINGLIGHT_ISA
