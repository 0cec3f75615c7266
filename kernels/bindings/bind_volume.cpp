#include "bindings/volume_inputs.hpp"
#include "simd/dispatch.hpp"

namespace ringlight {
namespace {

using Bits = Tensor<const std::int8_t, -1, -1, -1>;
using Counts = Tensor<std::int32_t, -1>;
using Offsets = Tensor<const std::int64_t, -1>;
// Origins, directions, jitter.
using Rays = std::tuple<Points, Points, Tensor<const float, -1>>;
// The box's corners and the cells', x y z each; bits; step; most samples.
using Space = std::tuple<std::array<float, 12>, Bits, float, int>;

constexpr std::size_t MOST = std::size_t{1} << 31;  // numbers of rows are of 32 bits

VolumeRays rays_from(const Rays& rays) {
  const auto& [origins, directions, jitter] = rays;
  require(origins.shape(0) == directions.shape(0) && origins.shape(0) == jitter.shape(0),
          "volume: rays must have as many origins, directions and jitters");
  return {origins.data(), directions.data(), jitter.data(), origins.shape(0)};
}

VolumeSpace space_from(const Space& space) {
  const auto& [corners, bits, step, most] = space;
  VolumeSpace made{};
  for (int axis = 0; axis < 3; axis++) {
    made.low[axis] = corners[axis], made.high[axis] = corners[3 + axis];
    made.cells_low[axis] = corners[6 + axis], made.cells_high[axis] = corners[9 + axis];
    require(made.low[axis] < made.high[axis] && made.cells_low[axis] < made.cells_high[axis],
            "volume: a box has no inside");
    require(bits.shape(axis) > 0 && bits.shape(axis) <= convention::VOLUME_MOST_NODES,
            "volume: no cells, or too many along an axis");
    made.cells[axis] = static_cast<int>(bits.shape(axis)) * (axis == 2 ? 8 : 1);
  }
  require(step > 0 && most >= 0 && most <= (1 << 20), "volume: a step must be positive, and a ray at most 2^20 long");
  made.bits = reinterpret_cast<const std::uint8_t*>(bits.data()), made.step = step, made.most = most;
  return made;
}

void require_offsets(const Offsets& offsets, std::size_t rays, std::size_t samples) {
  require(offsets.size() == rays + 1 && offsets.data()[0] == 0 && samples < MOST, "volume: offsets must be [R + 1]");
  for (std::size_t ray = 0; ray < rays; ray++)
    require(offsets.data()[ray] <= offsets.data()[ray + 1], "volume: offsets must rise");
  require(static_cast<std::size_t>(offsets.data()[rays]) == samples, "volume: offsets must end with all samples");
}

// Places, along, weights, left, slopes.
VolumeSamples samples_from(const Arrays& tensors) {
  require(tensors.size() == 5, "volume: five arrays of samples");
  const std::size_t count = tensors[1].size();
  require(tensors[0].size() == 3 * count, "volume: places must be [M 3]");
  for (std::size_t i = 2; i < 5; i++) require(tensors[i].size() == count, "volume: samples must be [M]");
  return {tensors[0].data(), tensors[1].data(), tensors[2].data(), tensors[3].data(), tensors[4].data()};
}

void count(const Rays& rays, const Space& space, Counts counts) {
  const VolumeRays from = rays_from(rays);
  const VolumeSpace within = space_from(space);
  require(counts.size() == from.count, "volume: a count for each ray");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_count)(from, within, counts.data());
}

void march(const Rays& rays, const Space& space, const Inputs& factors, std::tuple<float, float, float, float> optics,
           const Offsets& offsets, const Arrays& samples, Counts shown, Array alpha, Array depth) {
  const VolumeRays from = rays_from(rays);
  const VolumeSpace within = space_from(space);
  const auto grid = factors_from<const float>(factors);
  const VolumeSamples to = samples_from(samples);
  require_offsets(offsets, from.count, samples[1].size());
  require(shown.size() == from.count && alpha.size() == from.count && depth.size() == from.count,
          "volume: shown, alpha and depth must be [R]");
  const auto [shift, optical, least, end] = optics;
  const auto run = RINGLIGHT_CHOSEN(volume_march);
  const nb::gil_scoped_release unlocked;
  run(from, within, grid, {shift, optical, least, end}, offsets.data(), to, shown.data(), alpha.data(), depth.data());
}

void place(const Rays& rays, const Space& space, const Offsets& offsets, const Arrays& samples) {
  const VolumeRays from = rays_from(rays);
  const VolumeSpace within = space_from(space);
  const VolumeSamples to = samples_from(samples);
  require_offsets(offsets, from.count, samples[1].size());
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_place)(from, within, offsets.data(), to);
}

void weigh(const Offsets& offsets, Input densities, std::tuple<float, float, float, float> optics,
           const Arrays& samples, Counts shown, Array alpha, Array depth) {
  const std::size_t rays = shown.size();
  const VolumeSamples to = samples_from(samples);
  require_offsets(offsets, rays, samples[1].size());
  require(densities.size() == samples[1].size(), "volume: a density for each sample");
  require(alpha.size() == rays && depth.size() == rays, "volume: shown, alpha and depth must be [R]");
  const auto [shift, optical, least, end] = optics;
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_weigh)(rays, offsets.data(), densities.data(), {shift, optical, least, end}, to,
                                 shown.data(), alpha.data(), depth.data());
}

void density(const Inputs& factors, Points places, Array found) {
  const auto grid = factors_from<const float>(factors);
  require(found.size() == places.shape(0), "volume: a density for each place");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_density)(grid, places.data(), places.shape(0), found.data());
}

void require_shown(const Offsets& offsets, const Offsets& shown, std::size_t rays, std::size_t colors,
                   std::size_t samples) {
  require_offsets(offsets, rays, samples);
  require_offsets(shown, rays, colors);
}

void blend(const Offsets& offsets, const Offsets& shown, Input weights, float least, Points colors, Input alpha,
           Tensor<const float, 3> background, Tensor<float, -1, 3> blended) {
  const std::size_t rays = blended.shape(0);
  require_shown(offsets, shown, rays, colors.shape(0), weights.size());
  require(alpha.size() == rays, "volume: an alpha for each ray");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_blend)(rays, offsets.data(), shown.data(), weights.data(), least, colors.data(),
                                 alpha.data(), background.data(), blended.data());
}

void unblend(const Offsets& offsets, const Offsets& shown, const Arrays& samples, float least, Points colors,
             Tensor<const float, 3> background, Points grad_color, const std::optional<Input>& grad_alpha,
             const std::optional<Input>& grad_depth, Tensor<float, -1, 3> grad_colors, Array grad_density) {
  const std::size_t rays = grad_color.shape(0);
  const VolumeSamples from = samples_from(samples);
  require_shown(offsets, shown, rays, colors.shape(0), samples[1].size());
  require((!grad_alpha || grad_alpha->size() == rays) && (!grad_depth || grad_depth->size() == rays),
          "volume: gradients of alpha and depth must be [R]");
  require(grad_colors.shape(0) == colors.shape(0) && grad_density.size() == samples[1].size(),
          "volume: gradients must be of all colours and samples");
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_unblend)(rays, offsets.data(), shown.data(), from, least, colors.data(), background.data(),
                                   grad_color.data(), grad_alpha ? grad_alpha->data() : nullptr,
                                   grad_depth ? grad_depth->data() : nullptr, grad_colors.data(),
                                   grad_density.data());
}

std::size_t draw(Tensor<const float, -1, -1> gradient, double share, Counts rows, Array weights) {
  const std::size_t count = gradient.shape(0), width = gradient.shape(1);
  require(count < MOST && width >= 1 && width <= 3, "volume: a gradient has one to three numbers a row");
  require(rows.size() == count && weights.size() == count, "volume: rows and weights must have room for all");
  require(share > 0 && share <= 1, "volume: a share is more than 0, at most 1");
  const nb::gil_scoped_release unlocked;
  return RINGLIGHT_CHOSEN(volume_draw)(gradient.data(), count, static_cast<int>(width), share, rows.data(),
                                       weights.data());
}

void scatter(const Inputs& factors, Points places, const Numbers& samples, Input gradient,
             const Arrays& gradients) {
  const auto grid = factors_from<const float>(factors);
  const auto to = factors_from<float>(gradients);
  for (int axis = 0; axis < 3; axis++)
    require(grid.sides[axis] == to.sides[axis], "volume: gradients must have the factors' sizes");
  require(grid.components == to.components && grid.has_planes() == to.has_planes(),
          "volume: gradients must have the factors' sizes");
  const std::size_t rows = samples.size(), width = static_cast<std::size_t>(grid.width());
  const bool by_component = gradient.size() == rows * width;
  require(by_component || gradient.size() == rows, "volume: a gradient for each sample, or for each component of it");
  require_numbers(samples, places.shape(0));
  const nb::gil_scoped_release unlocked;
  RINGLIGHT_CHOSEN(volume_scatter)(grid, places.data(), samples.data(), rows, gradient.data(),
                                   by_component, to);
}

}  // namespace

void bind_volume(nb::module_& module) {
  module.def("volume_count", &count, "rays"_a, "space"_a, "counts"_a, "Samples of each ray that are not empty.");
  module.def("volume_march", &march, "rays"_a, "space"_a, "factors"_a, "optics"_a, "offsets"_a, "samples"_a, "shown"_a,
             "alpha"_a, "depth"_a,
             "Fills samples (places, along, weights, left, slopes) and, by ray, how many are shown, alpha and depth. "
             "Optics are the shift of density, the thickness of a step, the least weight that is shown, and the light "
             "at which a ray ends.");
  module.def("volume_place", &place, "rays"_a, "space"_a, "offsets"_a, "samples"_a,
             "Fills samples' places and along.");
  module.def("volume_weigh", &weigh, "offsets"_a, "densities"_a, "optics"_a, "samples"_a, "shown"_a, "alpha"_a,
             "depth"_a, "The rest of what volume_march fills, of densities before softplus.");
  module.def("volume_density", &density, "factors"_a, "places"_a, "density"_a, "Sums of all components.");
  module.def("volume_blend", &blend, "offsets"_a, "shown"_a, "weights"_a, "least"_a, "colors"_a, "alpha"_a,
             "background"_a, "blended"_a, "Colours of rays over the background.");
  module.def("volume_unblend", &unblend, "offsets"_a, "shown"_a, "samples"_a, "least"_a, "colors"_a, "background"_a,
             "grad_color"_a, "grad_alpha"_a.none(), "grad_depth"_a.none(), "grad_colors"_a, "grad_density"_a,
             "Gradients of the colours that are shown, and of what softplus is taken of.");
  module.def("volume_draw", &draw, "gradient"_a, "share"_a, "rows"_a, "weights"_a,
             "At most a share of the rows that have a gradient, drawn by importance: fills their numbers and what each "
             "counts, and returns how many.");
  module.def("volume_scatter", &scatter, "factors"_a, "places"_a, "samples"_a, "gradient"_a, "gradients"_a,
             "Adds the gradients of planes and lines, or of three lines, by samples, which are given by number.");
}

}  // namespace ringlight
