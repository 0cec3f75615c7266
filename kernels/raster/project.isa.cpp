// Stage 1: the table to ellipses, and the tiles that each of them touches.
#include "machine/parallel.hpp"
#include "raster/projection.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr float TILE = convention::TILE;
constexpr float ROOT_HALF_LOG2E = 0.849321800288019f;
// Tiles and blocks are found a little generously, for no rounding may lose a pixel with alpha >= 1/255. The blending
// kernels then test alpha itself.
constexpr float REACH_FACTOR = 1.0005f, REACH_MARGIN = 1e-5f;
constexpr float PIXEL_MARGIN = 2e-3f;
// Opacity factors may be large: 2^100 is opaque long before, and exp2 stays in its range.
constexpr float MAX_LOG2_OPACITY = 100.f;

// Ellipses of sixteen Gaussians, as the record stores them (raster.hpp), and their bounds.
struct Ellipses {
  Vec x, y, along_x, along_y, across_y, log2_opacity;
  Vec shear, spread, reach2, turn;
  Vec extent_x, extent_y;  // half-extents of alpha >= 1/255, pixels
  Vec radius_x, radius_y;  // the same as gsplat rounds them
  Mask drawn;
};

RINGLIGHT_INLINE Ellipses find_ellipses(const View& view, const Projection& p) {
  const Camera& camera = view.camera;
  Ellipses e;
  e.x = fma(Vec(camera.focal_x), p.slope[0], Vec(camera.center_x));
  e.y = fma(Vec(camera.focal_y), p.slope[1], Vec(camera.center_y));
  const Vec sigma_x = sqrt(p.cov_xx), sigma_y = sqrt(p.cov_yy), root_det = sqrt(p.det), one(1.f);
  const Vec inverse_y = one / sigma_y, inverse_yy = inverse_y * inverse_y, root_half_log2e(ROOT_HALF_LOG2E);
  e.shear = p.cov_xy * inverse_yy;
  e.spread = root_det * inverse_yy;
  e.along_x = root_half_log2e * sigma_y / root_det;
  e.along_y = -(e.shear * e.along_x);
  e.across_y = root_half_log2e * inverse_y;
  constexpr float TINY = 1e-30f;  // keeps log2 in its domain; such rows are culled
  e.log2_opacity = min(log2(max(p.opacity, Vec(TINY))), Vec(MAX_LOG2_OPACITY));

  const Vec reach = Vec(TWO_LN2) * (e.log2_opacity - Vec(LOG2_MIN_ALPHA));  // squared standard deviations
  const Vec sigmas = min(Vec(convention::MAX_SIGMAS), sqrt(max(reach, Vec(0.f))));
  e.radius_x = ceil(sigmas * sigma_x);
  e.radius_y = ceil(sigmas * sigma_y);
  const Vec generous = max(fma(reach, Vec(REACH_FACTOR), Vec(REACH_MARGIN)), Vec(0.f)), root_generous = sqrt(generous);
  e.extent_x = root_generous * sigma_x;
  e.extent_y = root_generous * sigma_y;
  e.reach2 = generous * p.cov_yy;
  e.turn = root_generous * p.cov_xy / sigma_x;

  const Vec width(static_cast<float>(camera.width)), height(static_cast<float>(camera.height)), zero(0.f);
  const Vec z = p.position[2];
  Mask drawn = both(both(ge(z, Vec(view.settings.near)), gt(z, zero)), both(gt(reach, zero), gt(p.det, zero)));
  // What is so far away that squares overflow would be a point at infinity, with gradients of infinity times zero.
  drawn = both(drawn, is_finite(fma(p.position[0], p.position[0], fma(p.position[1], p.position[1], z * z))));
  drawn = both(drawn, both(is_finite(e.along_x * e.turn), both(is_finite(p.det), is_finite(e.along_y * e.spread))));
  drawn = both(drawn, both(gt(e.x + e.radius_x, zero), lt(e.x - e.radius_x, width)));
  e.drawn = both(drawn, both(gt(e.y + e.radius_y, zero), lt(e.y - e.radius_y, height)));
  return e;
}

// 0 in every lane where all of `count` consecutive floats are finite, NaN where one is not.
RINGLIGHT_INLINE Vec zero_if_finite(const float* from, int count) {
  Vec zero(0.f);
  for (int k = 0; k < count; k += LANES)
    zero = fma(load_first(from + k, count - k < LANES ? count - k : LANES), Vec(0.f), zero);
  return zero;
}

RINGLIGHT_INLINE bool all_finite(Vec zero) { return bits(ge(zero, Vec(0.f))) == 0xffffu; }

// Rows whose parameters and channels are all finite. Nearly always all of them, so all are asked at once first.
RINGLIGHT_INLINE unsigned finite_rows(const Splats& splats, const SplatRows& rows, std::size_t first, int count) {
  const int width = splats.channel_count;
  const float* const channels = splats.channels + first * static_cast<std::size_t>(width);
  Vec zero = zero_if_finite(rows.means, 3 * LANES) + zero_if_finite(rows.log_scales, 3 * LANES);
  zero += zero_if_finite(rows.quats, 4 * LANES) + zero_if_finite(rows.opacity_logits, LANES);
  if (rows.opacity_factor) zero += zero_if_finite(rows.opacity_factor, LANES);
  zero += zero_if_finite(channels, count * width);
  unsigned finite = (1u << count) - 1;
  if (all_finite(zero)) return finite;
  for (int i = 0; i < count; i++) {
    zero = zero_if_finite(rows.means + 3 * i, 3) + zero_if_finite(rows.log_scales + 3 * i, 3);
    zero += zero_if_finite(rows.quats + 4 * i, 4) + zero_if_finite(rows.opacity_logits + i, 1);
    if (rows.opacity_factor) zero += zero_if_finite(rows.opacity_factor + i, 1);
    zero += zero_if_finite(channels + i * width, width);
    if (!all_finite(zero)) finite &= ~(1u << i);
  }
  return finite;
}

RINGLIGHT_INLINE void channel_columns(const SplatRows& rows, Vec* to) {
  for (int c = 0; c < RECORD_CHANNELS; c++) to[c] = Vec(0.f);
  if (rows.record_channels == 1) to[0] = load(rows.channels);
  if (rows.record_channels == 3) load_columns(rows.channels, to[0], to[1], to[2]);
  if (rows.record_channels == 4) load_columns(rows.channels, to[0], to[1], to[2], to[3]);
  if (rows.record_channels != 2) return;
  float columns[2][LANES];
  for (int i = 0; i < LANES; i++) columns[0][i] = rows.channels[2 * i], columns[1][i] = rows.channels[2 * i + 1];
  to[0] = load(columns[0]), to[1] = load(columns[1]);
}

RINGLIGHT_INLINE void write_records(const View& view, std::size_t first, const SplatRows& rows, const Ellipses& e) {
  Vec c[RECORD_CHANNELS];
  channel_columns(rows, c);
  Vec fields[RECORD] = {e.x, e.y, e.along_x, e.along_y, e.across_y, e.log2_opacity, c[0], c[1],
                        c[2], c[3], e.shear, e.spread, e.reach2, e.turn, Vec(NOT_LIT), Vec(0.f)};
  transpose(fields);
  for (int i = 0; i < LANES; i++) store(view.records + (first + static_cast<std::size_t>(i)) * RECORD, fields[i]);
}

// Bits 0-3: which of the 2 x 2 tiles at (x0, y0) the ellipse touches; exact up to the margin.
RINGLIGHT_INLINE IVec touched_2x2(const Ellipses& e, Vec x0, Vec y0, Vec x1, Vec y1) {
  const Vec zero(0.f), margin(PIXEL_MARGIN);
  IVec tiles = ivec(0);
  for (int row = 0; row < 2; row++) {
    const Vec top = fma(y0 + Vec(static_cast<float>(row)), Vec(TILE), Vec(0.5f)) - e.y;
    const Vec bottom = top + Vec(TILE - 1);
    const Vec left_at = min(max(-e.turn, top), bottom), right_at = min(max(e.turn, top), bottom);
    const Vec nearest = min(max(zero, top), bottom);
    const Vec offset = fnma(x0, Vec(TILE), e.x);
    const Vec left_width = sqrt(max(fnma(left_at, left_at, e.reach2), zero));
    const Vec right_width = sqrt(max(fnma(right_at, right_at, e.reach2), zero));
    const Vec left = fnma(e.spread, left_width, fma(e.shear, left_at, offset));
    const Vec right = fma(e.spread, right_width, fma(e.shear, right_at, offset));
    Mask in_row = both(e.drawn, ge(e.reach2 + Vec(1e-3f), nearest * nearest));
    if (row == 1) in_row = both(in_row, gt(y1, y0));
    const Mask first = both(ge(Vec(TILE - 0.5f), left - margin), ge(right + margin, Vec(0.5f)));
    const Mask second = both(ge(Vec(2 * TILE - 0.5f), left - margin), ge(right + margin, Vec(TILE + 0.5f)));
    tiles = tiles | keep(both(in_row, first), ivec(row == 0 ? 1 : 4));
    tiles = tiles | keep(both(in_row, both(second, gt(x1, x0))), ivec(row == 0 ? 2 : 8));
  }
  return tiles;
}

RINGLIGHT_INLINE float clamp(float value, float low, float high) {
  return value < low ? low : value > high ? high : value;
}

// The same test for one Gaussian and one tile.
bool touches(const float* record, int tile_x, int tile_y) {
  const float top = tile_y * TILE + 0.5f - record[CENTER_Y], bottom = top + TILE - 1;
  const float nearest = clamp(0.f, top, bottom), reach2 = record[REACH2], turn = record[TURN];
  if (nearest * nearest > reach2 + 1e-3f) return false;
  const float left_at = clamp(-turn, top, bottom), right_at = clamp(turn, top, bottom);
  const float left2 = reach2 - left_at * left_at, right2 = reach2 - right_at * right_at;
  const float offset = record[CENTER_X] - tile_x * TILE;
  const float left = offset + record[SHEAR] * left_at - record[SPREAD] * __builtin_sqrtf(left2 > 0 ? left2 : 0);
  const float right = offset + record[SHEAR] * right_at + record[SPREAD] * __builtin_sqrtf(right2 > 0 ? right2 : 0);
  return left - PIXEL_MARGIN <= TILE - 0.5f && right + PIXEL_MARGIN >= 0.5f;
}

// Fills in `tiles` of a rectangle larger than 2 x 2; returns the number of tiles.
unsigned list_tiles(const float* record, Placement& place) {
  const unsigned area = (place.x1 - place.x0 + 1u) * (place.y1 - place.y0 + 1u);
  place.tiles = EVERY_TILE;
  if (area > LISTED_TILES) return area;
  unsigned tiles = 0, bit = 0;
  for (int y = place.y0; y <= place.y1; y++)
    for (int x = place.x0; x <= place.x1; x++) tiles |= static_cast<unsigned>(touches(record, x, y)) << bit++;
  // All 31 bits would read as EVERY_TILE, which for 31 tiles says the same.
  place.tiles = tiles | LISTED;
  return static_cast<unsigned>(__builtin_popcount(tiles));
}

// What one task has seen so far.
struct Progress {
  Vec nearest, farthest;  // camera z of drawn rows, lane by lane
  std::uint32_t entries, drawn, broken;
};

RINGLIGHT_INLINE void place_rows(const View& view, std::size_t first, const Ellipses& e, Vec z, Progress& progress) {
  const Vec to_tiles(1.f / TILE), zero(0.f), half(0.5f);
  const Vec last_x(static_cast<float>(view.tiles_x - 1)), last_y(static_cast<float>(view.tiles_y - 1));
  const Vec x0 = floor(min(max((e.x - e.extent_x - half) * to_tiles, zero), last_x));
  const Vec x1 = floor(min(max((e.x + e.extent_x - half) * to_tiles, zero), last_x));
  const Vec y0 = floor(min(max((e.y - e.extent_y - half) * to_tiles, zero), last_y));
  const Vec y1 = floor(min(max((e.y + e.extent_y - half) * to_tiles, zero), last_y));
  const unsigned large = bits(both(e.drawn, gt(max(x1 - x0, y1 - y0), Vec(1.5f))));
  const IVec corners = truncate(x0) | shift_left<8>(truncate(y0)) | shift_left<16>(truncate(x1)) |
                       shift_left<24>(truncate(y1));
  const IVec tiles = touched_2x2(e, x0, y0, x1, y1), one = ivec(1);
  const IVec counts = (tiles & one) + (shift_right<1>(tiles) & one) + (shift_right<2>(tiles) & one) +
                      shift_right<3>(tiles);
  Placement* const places = view.placements + first;
  store_columns(reinterpret_cast<float*>(places), as_floats(corners), as_floats(tiles), zero, z);
  std::uint32_t entries[LANES];
  store(entries, counts);
  for (unsigned left = large; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    entries[i] = list_tiles(view.records + (first + static_cast<std::size_t>(i)) * RECORD, places[i]);
  }
  for (int i = 0; i < LANES; i++) {
    places[i].first_slot = progress.entries;
    progress.entries += entries[i];
  }
  const Mask drawn = gt(to_float(load_ints(entries)), zero);
  progress.nearest = min(progress.nearest, select(drawn, z, progress.nearest));
  progress.farthest = max(progress.farthest, keep(drawn, z));
  progress.drawn += static_cast<std::uint32_t>(__builtin_popcount(bits(drawn)));
  for (unsigned hidden = ~bits(drawn) & 0xffffu; hidden; hidden &= hidden - 1)
    places[__builtin_ctz(hidden)].depth_key = NOT_DRAWN;
}

RINGLIGHT_INLINE Piece summary(const Progress& progress) {
  float nearest[LANES], farthest[LANES];
  store(nearest, progress.nearest);
  store(farthest, progress.farthest);
  for (int i = 1; i < LANES; i++) {
    nearest[0] = nearest[i] < nearest[0] ? nearest[i] : nearest[0];
    farthest[0] = farthest[i] > farthest[0] ? farthest[i] : farthest[0];
  }
  Piece piece{0, progress.entries, progress.drawn, NOT_DRAWN, 0, progress.broken};
  if (progress.drawn == 0) return piece;
  __builtin_memcpy(&piece.nearest, &nearest[0], sizeof piece.nearest);
  __builtin_memcpy(&piece.farthest, &farthest[0], sizeof piece.farthest);
  return piece;
}

RINGLIGHT_INLINE void write_footprints(const Footprints& to, std::size_t first, int count, const Ellipses& e) {
  const Vec x = keep(e.drawn, e.x), y = keep(e.drawn, e.y);
  const Vec radius_x = keep(e.drawn, e.radius_x), radius_y = keep(e.drawn, e.radius_y);
  if (count == LANES) {
    store_columns(to.means2d + 2 * first, x, y);
    store_columns(to.radii + 2 * first, radius_x, radius_y);
    return;
  }
  float means2d[2 * LANES], radii[2 * LANES];
  store_columns(means2d, x, y);
  store_columns(radii, radius_x, radius_y);
  for (int k = 0; k < 2 * count; k++) {
    to.means2d[2 * first + k] = means2d[k];
    to.radii[2 * first + k] = radii[k];
  }
}

void project_piece(const View& view, const Footprints& footprints, std::size_t begin, std::size_t end) {
  constexpr float FARTHEST = 3e38f;
  Progress progress{Vec(FARTHEST), Vec(0.f), 0, 0, 0};
  for (std::size_t first = begin; first < end; first += LANES) {
    const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
    SplatRows rows;
    take_rows(view.splats, first, count, rows);
    Projection p;
    project_rows(view, rows, p);
    Ellipses e = find_ellipses(view, p);
    const unsigned finite = finite_rows(view.splats, rows, first, count);
    progress.broken += static_cast<std::uint32_t>(count - __builtin_popcount(finite));
    e.drawn = both(e.drawn, mask_from_bits(finite));
    write_records(view, first, rows, e);
    place_rows(view, first, e, p.position[2], progress);
    write_footprints(footprints, first, count, e);
  }
  view.pieces[begin / ROWS_PER_PIECE] = summary(progress);
}

}  // namespace

void project(const View& view, const Footprints& footprints) {
  parallel_ranges(view.splats.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    project_piece(view, footprints, begin, end);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
