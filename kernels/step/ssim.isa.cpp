#include "step/ssim.hpp"

#include "simd/simd.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

using namespace ssim;

// exp(-k^2 / (2 * 1.5^2)) for k = 0 .. 5, scaled so that the eleven taps sum to 1.
constexpr float T0 = 0.266011725f, T1 = 0.213005538f, T2 = 0.109360690f, T3 = 0.036000772f, T4 = 0.007598758f,
                T5 = 0.001028380f;
constexpr float C1 = 0.01f * 0.01f, C2 = 0.03f * 0.03f;

[[gnu::always_inline]] inline float window(const float* center) {
  return T0 * center[0] + T1 * (center[-1] + center[1]) + T2 * (center[-2] + center[2]) +
         T3 * (center[-3] + center[3]) + T4 * (center[-4] + center[4]) + T5 * (center[-5] + center[5]);
}

// Never inlined into a loop that does more: the compiler then keeps eleven shifted pointers in memory.
[[gnu::noinline]] void blur_along(const float* __restrict row, float* __restrict out, long width) {
  for (long x = 0; x < width; x++) out[x] = window(row + x);
}

template <int K>
RINGLIGHT_INLINE Vec tap(float weight, const float* row, Vec before, Vec own, Vec after, Vec sum) {
  const Vec pair = load_shifted<-K>(row, before, own, after) + load_shifted<K>(row, before, own, after);
  return fma(Vec(weight), pair, sum);
}

// The same over whole vectors of scratch rows, whose margins may be read.
[[gnu::noinline]] void blur_scratch(const float* __restrict row, float* __restrict out, long padded_width) {
  Vec before = load(row - LANES), own = load(row);
  for (long x = 0; x < padded_width; x += LANES) {
    const float* const at = row + x;
    const Vec after = load(at + LANES);
    Vec sum = Vec(T0) * own;
    sum = tap<1>(T1, at, before, own, after, sum);
    sum = tap<2>(T2, at, before, own, after, sum);
    sum = tap<3>(T3, at, before, own, after, sum);
    sum = tap<4>(T4, at, before, own, after, sum);
    sum = tap<5>(T5, at, before, own, after, sum);
    store(out + x, sum);
    before = own;
    own = after;
  }
}

// Vertical blur of a (or of a * b) over SPAN rows into GROUP rows. Never inlined: x * x, x * y and y * y then round
// alike, so that equal images have equal second moments.
template <bool PRODUCT>
[[gnu::noinline]] void blur_down(const float* const* a, const float* const* b, float* const* out, int width) {
#pragma GCC ivdep
  for (long x = 0; x < width; x++) {
    float v[SPAN];
#pragma GCC unroll 14
    for (int j = 0; j < SPAN; j++) v[j] = PRODUCT ? a[j][x] * b[j][x] : a[j][x];
#pragma GCC unroll 4
    for (int r = 0; r < GROUP; r++) out[r][x] = window(v + r + REACH);
  }
}

// Where a strip lies, and its scratch rows. Zeros surround every vertical blur, so rows need no border cases.
struct Strip {
  int begin, end, height, width;
  std::size_t offset, stride;  // of the plane in the image; of scratch rows
  float *zeros, *pixel, *similarity, *not_counted, *blurred, *derivatives, *means;

  Strip(const Planes& planes, std::size_t index, float* scratch) : height(planes.height), width(planes.width) {
    const int count = strips_per_plane(height), number = static_cast<int>(index % count);
    begin = static_cast<int>(static_cast<long>(height) * number / count);
    end = static_cast<int>(static_cast<long>(height) * (number + 1) / count);
    offset = index / count * plane_floats(planes);
    stride = row_floats(width);
    for (std::size_t i = 0; i < ZEROED_ROWS * stride; i++) scratch[i] = 0;
    zeros = scratch + MARGIN;
    pixel = zeros + stride;
    similarity = pixel + stride;
    not_counted = similarity + stride;
    blurred = not_counted + stride;
    derivatives = blurred + QUANTITIES * GROUP * stride;
    means = derivatives + QUANTITIES * RING * stride;
  }

  // Scratch rows may be filled beyond the width: whole vectors, no remainder.
  long padded_width() const { return static_cast<long>(stride) - 2 * MARGIN; }
  bool inside(int row) const { return row >= 0 && row < height; }
  std::size_t at(int row) const { return offset + static_cast<std::size_t>(row) * width; }
  float* blur(int quantity, int row) const { return blurred + (quantity * GROUP + row) * stride; }
  float* mean(int quantity) const { return means + quantity * stride; }
  float* derivative(int quantity, int row) const {
    return derivatives + (quantity * RING + ((row + RING) & (RING - 1))) * stride;
  }

  // Rows first - REACH .. first + GROUP + REACH of a plane; zeros beyond the image.
  void rows_of(const float* image, int first, const float** rows) const {
    for (int j = 0; j < SPAN; j++) {
      const int row = first - REACH + j;
      rows[j] = inside(row) ? image + at(row) : zeros;
    }
  }
};

template <bool PRODUCT>
void blur_group(const Strip& strip, int quantity, const float* const* a, const float* const* b) {
  float* out[GROUP];
  for (int r = 0; r < GROUP; r++) out[r] = strip.blur(quantity, r);
  blur_down<PRODUCT>(a, b, out, strip.width);
}

// SSIM of one row, and its derivatives with respect to blur(x), blur(x x) and, halved, blur(x y).
void compare_row(const Strip& strip, int group_row, int row, const PhotometricImages& images, float* similarity) {
  const float *b0 = strip.mean(0), *b1 = strip.mean(1), *b2 = strip.mean(2);
  for (int q = 0; q < QUANTITIES; q++) blur_scratch(strip.blur(q, group_row), strip.mean(q), strip.padded_width());
  const float *my = images.target_blur + strip.at(row), *eyy = images.target_square_blur + strip.at(row);
  float *q0 = strip.derivative(0, row), *q1 = strip.derivative(1, row), *q2 = strip.derivative(2, row);
  const int width = strip.width;
#pragma GCC ivdep
  for (long x = 0; x < width; x++) {
    const float mean_x = b0[x], square_x = b1[x], product = b2[x];
    const float mean_y = my[x];
    const float xx = mean_x * mean_x, yy = mean_y * mean_y, xy = mean_x * mean_y;
    const float luminance = 2 * xy + C1, contrast = 2 * (product - xy) + C2;
    const float a = xx + yy + C1, b = (square_x - xx) + (eyy[x] - yy) + C2;
    const float inverse = 1 / (a * b);  // one division for the two quotients
    const float ssim = luminance * contrast * inverse;
    similarity[x] += ssim;
    q0[x] = 2 * inverse * (mean_y * (contrast - luminance)) + 2 * inverse * (mean_x * ssim * (a - b));
    q1[x] = -ssim * a * inverse;
    q2[x] = luminance * inverse;
  }
}

// Gradient of one row: the window is symmetric, so the derivatives are blurred once more. The same loop sums the
// pixel term.
template <bool SQUARED>
void gradient_row(const Strip& strip, int group_row, int row, const PhotometricImages& images, float pixel_weight,
                  float ssim_weight) {
  const float *b0 = strip.mean(0), *b1 = strip.mean(1), *b2 = strip.mean(2);
  for (int q = 0; q < QUANTITIES; q++) blur_scratch(strip.blur(q, group_row), strip.mean(q), strip.padded_width());
  const float *image = images.image + strip.at(row), *target = images.target + strip.at(row);
  float *gradient = images.gradient + strip.at(row), *pixel = strip.pixel;
  const int width = strip.width;
#pragma GCC ivdep
  for (long x = 0; x < width; x++) {
    const float p = image[x], t = target[x], d = p - t;
    const float structure = b0[x] + 2 * (p * b1[x] + t * b2[x]);
    // Not (d > 0) - (d < 0): a NaN must stay one.
    const float sign = d > 0 ? 1.0f : d < 0 ? -1.0f : d;
    pixel[x] += SQUARED ? d * d : __builtin_fabsf(d);
    gradient[x] = pixel_weight * (SQUARED ? 2 * d : sign) - ssim_weight * structure;
  }
}

// Derivatives of the rows first .. first + GROUP. Rows of the neighbouring strips feed this strip's gradient, but
// their similarity is counted over there.
void similarity_group(const Strip& strip, int first, const PhotometricImages& images) {
  if (first + GROUP <= 0 || first >= strip.height) return;
  const float *x[SPAN], *y[SPAN];
  strip.rows_of(images.image, first, x);
  strip.rows_of(images.target, first, y);
  blur_group<false>(strip, 0, x, x);
  blur_group<true>(strip, 1, x, x);
  blur_group<true>(strip, 2, x, y);
  for (int r = 0; r < GROUP; r++) {
    const int row = first + r;
    if (!strip.inside(row) || row >= strip.end + REACH) continue;
    const bool own = row >= strip.begin && row < strip.end;
    compare_row(strip, r, row, images, own ? strip.similarity : strip.not_counted);
  }
}

void gradient_group(const Strip& strip, int first, const PhotometricImages& images, const PhotometricWeights& mean) {
  for (int quantity = 0; quantity < QUANTITIES; quantity++) {
    const float* rows[SPAN];
    for (int j = 0; j < SPAN; j++) {
      const int row = first - REACH + j;
      rows[j] = strip.inside(row) ? strip.derivative(quantity, row) : strip.zeros;
    }
    blur_group<false>(strip, quantity, rows, rows);
  }
  for (int row = first; row < first + GROUP && row < strip.end; row++) {
    if (mean.squared) gradient_row<true>(strip, row - first, row, images, mean.pixel, mean.similarity);
    else gradient_row<false>(strip, row - first, row, images, mean.pixel, mean.similarity);
  }
}

double sum(const float* row, int width) {
  double total = 0;
  for (long x = 0; x < width; x++) total += row[x];
  return total;
}

}  // namespace

StripSums photometric_strip(const PhotometricImages& images, const Planes& planes, const PhotometricWeights& weights,
                            std::size_t index, float* scratch) {
  const Strip strip(planes, index, scratch);
  const float scale = 1 / static_cast<float>(planes.channels * plane_floats(planes));
  const PhotometricWeights mean{weights.pixel * scale, weights.similarity * scale, weights.squared};
  // The ring holds just the SPAN derivative rows of a gradient group, rounded up to whole groups.
  int derived = strip.begin - REACH;
  for (int first = strip.begin; first < strip.end; first += GROUP) {
    for (; derived < first + GROUP + REACH; derived += GROUP) similarity_group(strip, derived, images);
    gradient_group(strip, first, images, mean);
  }
  return {sum(strip.pixel, strip.width), sum(strip.similarity, strip.width)};
}

void blur_strip(const float* image, const Planes& planes, std::size_t index, float* blur, float* square_blur,
                float* scratch) {
  const Strip strip(planes, index, scratch);
  for (int first = strip.begin; first < strip.end; first += GROUP) {
    const float* rows[SPAN];
    strip.rows_of(image, first, rows);
    blur_group<false>(strip, 0, rows, rows);
    blur_group<true>(strip, 1, rows, rows);
    for (int row = first; row < first + GROUP && row < strip.end; row++) {
      blur_along(strip.blur(0, row - first), blur + strip.at(row), strip.width);
      blur_along(strip.blur(1, row - first), square_blur + strip.at(row), strip.width);
    }
  }
}

}  // namespace ringlight::RINGLIGHT_ISA
