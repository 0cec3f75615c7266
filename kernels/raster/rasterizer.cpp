#include "raster/rasterizer.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

#include "machine/parallel.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

std::size_t piece_count(const View& view) { return (view.splats.count + ROWS_PER_PIECE - 1) / ROWS_PER_PIECE; }

int tiles_along(int pixels) { return (pixels + convention::TILE - 1) / convention::TILE; }

// Times consecutive stages.
class Stopwatch {
 public:
  explicit Stopwatch(double* seconds) : seconds_(seconds) {}
  void end(Stage stage) {
    const auto now = std::chrono::steady_clock::now();
    seconds_[stage] = std::chrono::duration<double>(now - since_).count();
    since_ = now;
  }

 private:
  double* seconds_;
  std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
};

bool all_zero(const float* values, std::size_t count) {
  for (std::size_t i = 0; i < count; i++)
    if (values[i] != 0) return false;
  return true;
}

// The last channels whose gradient is zero everywhere are left out: a depth that only a shader looks at, say. The first
// RECORD_CHANNELS + 1 stay: kernels of fewer expect them in the records, where wider tables have none.
int gradient_channels(const View& view, const float* image_gradient) {
  const std::size_t plane = std::size_t(view.camera.width) * std::size_t(view.camera.height);
  int channels = view.splats.channel_count;
  const auto last = [&] { return image_gradient + (static_cast<std::size_t>(channels) - 1) * plane; };
  while (channels > RECORD_CHANNELS + 1 && all_zero(last(), plane)) channels--;
  return channels;
}

}  // namespace

void Workspace::make_room() {
  const std::size_t rows = (view_.splats.count + LANES - 1) / LANES * LANES;
  const std::size_t tiles = static_cast<std::size_t>(view_.tiles_x) * static_cast<std::size_t>(view_.tiles_y);
  view_.records = records_.reserve(rows * RECORD);
  view_.placements = placements_.reserve(rows);
  view_.pieces = pieces_.reserve(piece_count(view_));
  view_.tile_used = tile_used_.reserve(tiles);
  view_.final_transmittance = final_transmittance_.reserve(tiles * BLOCKS * LANES);
}

// Each worker needs the states of a tile's blocks and, forward, a chunk's rows and weights; backward, one row of
// channels and the weights of its blocks. A shader's floats come last.
void Workspace::reserve_scratch(std::size_t of_shader) {
  const int channels = view_.splats.channel_count;
  const auto floats = [](int n) { return static_cast<std::size_t>(n); };
  const std::size_t states = BLOCKS * floats(state_stride(channels));
  const std::size_t width = floats(round_up_lanes(channels)), row = floats(row_stride(padded_channels(channels)));
  view_.workers = threads();
  view_.scratch_stride = states + std::max(CHUNK * (row + LANES), width + BLOCKS * LANES) + of_shader;
  if (view_.lazy) view_.scratch_stride += view_.lazy->scratch;
  view_.scratch_stride = (view_.scratch_stride + LANES - 1) / LANES * LANES;
  view_.scratch = scratch_.reserve(static_cast<std::size_t>(view_.workers) * view_.scratch_stride);
}

// Gives every piece its first slot; returns the number of drawn Gaussians. Refuses a table that is not all finite.
std::uint64_t Workspace::number_slots() {
  std::uint64_t slots = 0, drawn = 0, broken = 0;
  for (std::size_t i = 0; i < piece_count(view_); i++) {
    view_.pieces[i].first_slot = slots;
    slots += view_.pieces[i].entries;
    drawn += view_.pieces[i].drawn;
    broken += view_.pieces[i].broken;
  }
  if (broken)
    throw std::domain_error("rasterizer: " + std::to_string(broken) + " rows hold a value that is not finite");
  // Five times what six million Gaussians ask for at 4K, and half a minute of one core at worst: Gaussians that cover
  // everything and hide nothing would otherwise keep it busy for hours. Half an entry must be able to name its slot.
  constexpr std::uint64_t MAX_SLOTS = std::uint64_t{1} << 27;
  if (slots > MAX_SLOTS) throw std::bad_alloc();
  slots_in_use_ = slots;
  return drawn;
}

void Workspace::forward(const Camera& camera, const RasterSettings& settings, const Splats& splats,
                        const Images& images, const Footprints& footprints, const LazyColors* lazy) {
  complete_ = false;
  view_.camera = camera;
  view_.settings = settings;
  view_.splats = splats;
  view_.tiles_x = tiles_along(camera.width);
  view_.tiles_y = tiles_along(camera.height);
  make_room();
  lazy_broken_ = false;
  view_.lazy = lazy, view_.lazy_broken = &lazy_broken_;
  reserve_scratch(images.shader ? images.shader->scratch : 0);
  Stopwatch watch(seconds_);
  RINGLIGHT_CHOSEN(project)(view_, footprints);
  const std::uint64_t drawn = number_slots();
  watch.end(PROJECT);
  const std::uint64_t* const order = sort_.sort(view_, drawn);
  watch.end(SORT);
  binning_.bin(view_, order, drawn);
  view_.block_masks = block_masks_.reserve(slots_in_use_);
  watch.end(BIN);
  RINGLIGHT_CHOSEN(blend)(view_, images);
  watch.end(BLEND);
  view_.lazy = nullptr;
  const bool is_kept = (!images.shader || images.blended || images.tiles) && (!lazy || lazy->kept);
  complete_ = is_kept && !images.early_stop && !lazy_broken_;
  if (lazy && lazy_broken_) throw std::domain_error("rasterizer: colours are not finite");
}

void Workspace::backward(const Splats& splats, const ImageGradients& from, const SplatGradients& to) {
  view_.splats = splats;
  reserve_scratch(0);  // the number of threads may have changed
  view_.gradient_channels = from.drawn ? from.channels : gradient_channels(view_, from.image_gradient);
  const std::size_t stride = static_cast<std::size_t>(slot_stride(view_.gradient_channels, view_.settings.absgrad));
  view_.slots = slots_.reserve(slots_in_use_ * stride);
  view_.slot_used = slot_used_.reserve(slots_in_use_);
  if (slots_in_use_) std::memset(view_.slot_used, 0, slots_in_use_);
  Stopwatch watch(seconds_);
  RINGLIGHT_CHOSEN(blend_gradient)(view_, from);
  watch.end(BLEND_GRADIENT);
  RINGLIGHT_CHOSEN(project_gradient)(view_, to);
  watch.end(PROJECT_GRADIENT);
}

}  // namespace ringlight
