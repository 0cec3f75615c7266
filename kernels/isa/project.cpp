// Stage 1: the table to ellipses, and the tiles that each of them touches.
#include "../parallel.hpp"
#include "projection.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr float TILE = convention::TILE;
constexpr float LOG2_MIN_ALPHA = -7.99435343685886f;  // log2(1 / 255)
constexpr float TWO_LN2 = 1.38629436111989f;
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

RINGLIGHT_INLINE Ellipses find_ellipses(const Frame& frame, const Projection& p) {
  const Pinhole& camera = frame.camera;
  Ellipses e;
  e.x = fma(Vec(camera.focal_x), p.slope[0], Vec(camera.center_x));
  e.y = fma(Vec(camera.focal_y), p.slope[1], Vec(camera.center_y));
  const Vec half_log2e(0.5f * convention::LOG2_E);
  const Vec inverse_yy = Vec(1.f) / p.cov_yy;
  e.shear = p.cov_xy * inverse_yy;
  e.along_x = sqrt(half_log2e * p.cov_yy / p.det);
  e.along_y = -(e.shear * e.along_x);
  e.across_y = sqrt(half_log2e * inverse_yy);
  constexpr float TINY = 1e-30f;  // keeps log2 in its domain; such rows are culled
  e.log2_opacity = min(log2(max(p.opacity, Vec(TINY))), Vec(MAX_LOG2_OPACITY));

  const Vec reach = Vec(TWO_LN2) * (e.log2_opacity - Vec(LOG2_MIN_ALPHA));  // squared standard deviations
  const Vec sigmas = min(Vec(convention::MAX_SIGMAS), sqrt(max(reach, Vec(0.f))));
  e.radius_x = ceil(sigmas * sqrt(p.cov_xx));
  e.radius_y = ceil(sigmas * sqrt(p.cov_yy));
  const Vec generous = max(fma(reach, Vec(REACH_FACTOR), Vec(REACH_MARGIN)), Vec(0.f));
  e.extent_x = sqrt(generous * p.cov_xx);
  e.reach2 = generous * p.cov_yy;
  e.extent_y = sqrt(e.reach2);
  e.spread = sqrt(p.det) * inverse_yy;
  e.turn = p.cov_xy / p.cov_xx * e.extent_x;

  const Vec width(static_cast<float>(camera.width)), height(static_cast<float>(camera.height)), zero(0.f);
  const Vec z = p.position[2];
  Mask drawn = both(both(ge(z, Vec(frame.settings.near)), gt(z, zero)), both(gt(reach, zero), gt(p.det, zero)));
  drawn = both(drawn, both(is_finite(e.along_x * e.turn), both(is_finite(p.det), is_finite(e.along_y * e.spread))));
  drawn = both(drawn, both(gt(e.x + e.radius_x, zero), lt(e.x - e.radius_x, width)));
  e.drawn = both(drawn, both(gt(e.y + e.radius_y, zero), lt(e.y - e.radius_y, height)));
  return e;
}

// Rows whose parameters and channels are all finite.
RINGLIGHT_INLINE unsigned finite_rows(const Splats& splats, const SplatRows& rows, std::size_t first, int count) {
  Vec a, b, c, d;
  load_columns(rows.means, a, b, c);
  Vec zero = (a + b + c) * Vec(0.f);
  load_columns(rows.log_scales, a, b, c);
  zero += a * Vec(0.f) + b * Vec(0.f) + c * Vec(0.f);
  load_columns(rows.quats, a, b, c, d);
  zero += a * Vec(0.f) + b * Vec(0.f) + c * Vec(0.f) + d * Vec(0.f);
  zero += load(rows.opacity_logits) * Vec(0.f);
  if (rows.opacity_factor) zero += load(rows.opacity_factor) * Vec(0.f);
  unsigned finite = bits(ge(zero, Vec(0.f)));
  const int channels = splats.channel_count;
  if (channels == 3 && count == LANES) {
    load_columns(splats.channels + 3 * first, a, b, c);
    return finite & bits(ge(a * Vec(0.f) + b * Vec(0.f) + c * Vec(0.f), Vec(0.f)));
  }
  for (int i = 0; i < count; i++) {
    const float* row = splats.channels + (first + i) * channels;
    Vec sum(0.f);
    for (int k = 0; k < channels; k += LANES)
      sum += load_first(row + k, channels - k < LANES ? channels - k : LANES) * Vec(0.f);
    if (bits(ge(sum, Vec(0.f))) != 0xffffu) finite &= ~(1u << i);
  }
  return finite & ((1u << count) - 1);
}

RINGLIGHT_INLINE void write_records(const Frame& frame, std::size_t first, int count, const Ellipses& e) {
  const Vec zero(0.f);
  Vec rows[LANES] = {e.x, e.y, e.along_x, e.along_y, e.across_y, e.log2_opacity, zero, zero,
                     zero, zero, e.shear, e.spread, e.reach2, e.turn, zero, zero};
  transpose(rows);
  const int channels = frame.splats.channel_count;
  for (int i = 0; i < count; i++) {
    float* record = frame.records + (first + i) * RECORD;
    store(record, rows[i]);
    if (channels > RECORD_CHANNELS) continue;
    const float* row = frame.splats.channels + (first + i) * channels;
    for (int k = 0; k < channels; k++) record[FIRST_CHANNELS + k] = row[k];
  }
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
    const Vec left = fnma(e.spread, sqrt(max(fnma(left_at, left_at, e.reach2), zero)), fma(e.shear, left_at, offset));
    const Vec right = fma(e.spread, sqrt(max(fnma(right_at, right_at, e.reach2), zero)), fma(e.shear, right_at, offset));
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
unsigned list_tiles(const float* record, TileRect& rect) {
  const unsigned area = (rect.x1 - rect.x0 + 1u) * (rect.y1 - rect.y0 + 1u);
  rect.tiles = EVERY_TILE;
  if (area > LISTED_TILES) return area;
  unsigned tiles = 0, bit = 0;
  for (int y = rect.y0; y <= rect.y1; y++)
    for (int x = rect.x0; x <= rect.x1; x++) tiles |= static_cast<unsigned>(touches(record, x, y)) << bit++;
  // All 31 bits would read as EVERY_TILE, which for 31 tiles says the same.
  rect.tiles = tiles | LISTED;
  return static_cast<unsigned>(__builtin_popcount(tiles));
}

RINGLIGHT_INLINE void assign_tiles(const Frame& frame, std::size_t first, int count, const Ellipses& e, Vec z,
                                   Piece& piece) {
  const Vec to_tiles(1.f / TILE), zero(0.f), half(0.5f);
  const Vec last_x(static_cast<float>(frame.tiles_x - 1)), last_y(static_cast<float>(frame.tiles_y - 1));
  const Vec x0 = floor(min(max((e.x - e.extent_x - half) * to_tiles, zero), last_x));
  const Vec x1 = floor(min(max((e.x + e.extent_x - half) * to_tiles, zero), last_x));
  const Vec y0 = floor(min(max((e.y - e.extent_y - half) * to_tiles, zero), last_y));
  const Vec y1 = floor(min(max((e.y + e.extent_y - half) * to_tiles, zero), last_y));
  const unsigned large = bits(both(e.drawn, gt(max(x1 - x0, y1 - y0), Vec(1.5f))));
  const IVec corners = truncate(x0) | shift_left<8>(truncate(y0)) | shift_left<16>(truncate(x1)) |
                       shift_left<24>(truncate(y1));
  std::uint64_t rects[LANES];
  std::uint32_t keys[LANES];
  store_words(rects, corners, touched_2x2(e, x0, y0, x1, y1));
  store(keys, as_bits(z));
  for (int i = 0; i < count; i++) {
    const std::size_t row = first + i;
    TileRect& rect = frame.rects[row];
    __builtin_memcpy(&rect, &rects[i], sizeof rect);
    unsigned entries = static_cast<unsigned>(__builtin_popcount(rect.tiles));
    if (__builtin_expect(large >> i & 1, 0)) entries = list_tiles(frame.records + row * RECORD, rect);
    frame.slots_of[row] = piece.entries;
    piece.entries += entries;
    frame.depth_keys[row] = entries ? keys[i] : NOT_DRAWN;
    if (!entries) continue;
    piece.drawn++;
    piece.nearest = keys[i] < piece.nearest ? keys[i] : piece.nearest;
    piece.farthest = keys[i] > piece.farthest ? keys[i] : piece.farthest;
  }
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

void project_piece(const Frame& frame, const Footprints& footprints, std::size_t begin, std::size_t end) {
  Piece piece{0, 0, 0, NOT_DRAWN, 0};
  for (std::size_t first = begin; first < end; first += LANES) {
    const int count = end - first < LANES ? static_cast<int>(end - first) : LANES;
    SplatRows rows;
    take_rows(frame.splats, first, count, rows);
    Projection p;
    project_rows(frame, rows, p);
    Ellipses e = find_ellipses(frame, p);
    e.drawn = both(e.drawn, mask_from_bits(finite_rows(frame.splats, rows, first, count)));
    write_records(frame, first, count, e);
    assign_tiles(frame, first, count, e, p.position[2], piece);
    write_footprints(footprints, first, count, e);
  }
  frame.pieces[begin / ROWS_PER_PIECE] = piece;
}

}  // namespace

void project(const Frame& frame, const Footprints& footprints) {
  parallel_ranges(frame.splats.count, ROWS_PER_PIECE, [&](std::size_t begin, std::size_t end) {
    project_piece(frame, footprints, begin, end);
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
