// Gradients of planes and lines. Sixteen components of one pair, or of three lines, are a piece, which goes through all
// samples in order: no two threads write to one number, and sums have one order.
#include "machine/parallel.hpp"
#include "volume/factors.isa.hpp"

namespace ringlight::RINGLIGHT_ISA {
namespace {

constexpr std::size_t AHEAD = 4;  // samples whose corners are fetched before they are wanted

struct Piece {
  const float *plane, *line;
  float *grad_plane, *grad_line;
  int pair, first;
};

void fetch(const VolumeFactors<const float>& factors, const Piece& piece, const float* place) {
  const Corners at = corners_of(factors, piece.pair, place);
  for (int corner = 0; corner < 4; corner++) {
    __builtin_prefetch(piece.plane + at.plane[corner] + piece.first);
    __builtin_prefetch(piece.grad_plane + at.plane[corner] + piece.first, 1);
  }
}

void add(float* to, Vec value) { store(to, load(to) + value); }

void add_sample(const VolumeFactors<const float>& factors, const Piece& piece, const float* place, Vec gradient) {
  const Corners at = corners_of(factors, piece.pair, place);
  const Vec by_plane = gradient * on_line(piece.line, at, piece.first);
  const Vec by_line = gradient * on_plane(piece.plane, at, piece.first);
  for (int corner = 0; corner < 4; corner++)
    add(piece.grad_plane + at.plane[corner] + piece.first, by_plane * Vec(at.plane_share[corner]));
  for (int end = 0; end < 2; end++)
    add(piece.grad_line + at.line[end] + piece.first, by_line * Vec(at.line_share[end]));
}

// Of three lines, components from `first` on.
void add_sample_of_lines(const VolumeFactors<const float>& factors, const VolumeFactors<float>& gradients, int first,
                         const float* place, Vec gradient) {
  const OnLines at = on_lines(factors, place);
  Vec values[3];
  for (int axis = 0; axis < 3; axis++) values[axis] = along(factors, at, axis, first);
  for (int axis = 0; axis < 3; axis++) {
    const Vec here = gradient * values[(axis + 1) % 3] * values[(axis + 2) % 3];
    float* to = gradients.lines[axis] + at.low[axis] + first;
    add(to, here * Vec(1.f - at.share[axis]));
    add(to + at.width, here * Vec(at.share[axis]));
  }
}

}  // namespace

void volume_scatter(const VolumeFactors<const float>& factors, const float* places, const std::int32_t* samples,
                    std::size_t count, const float* gradient, bool by_component,
                    const VolumeFactors<float>& gradients) {
  const std::size_t blocks = static_cast<std::size_t>(factors.components / LANES);
  const std::size_t width = static_cast<std::size_t>(factors.width());
  const VolumeFactors<const float>* const values = &factors;
  const VolumeFactors<float>* const to = &gradients;
  if (!factors.has_planes()) {
    parallel_for(blocks, [=](std::size_t block) {
      const int first = static_cast<int>(block) * LANES;
      for (std::size_t i = 0; i < count; i++)
        add_sample_of_lines(*values, *to, first, places + 3 * static_cast<std::size_t>(samples[i]),
                            by_component ? load(gradient + i * width + first) : Vec(gradient[i]));
    });
    return;
  }
  parallel_for(VOLUME_PAIRS * blocks, [=](std::size_t number) {
    const int pair = static_cast<int>(number / blocks), first = static_cast<int>(number % blocks) * LANES;
    const Piece piece{values->planes[pair], values->lines[pair], to->planes[pair], to->lines[pair], pair, first};
    const std::size_t column = static_cast<std::size_t>(pair) * values->components + first;
    for (std::size_t i = 0; i < count; i++) {
      if (i + AHEAD < count) fetch(*values, piece, places + 3 * static_cast<std::size_t>(samples[i + AHEAD]));
      const Vec here = by_component ? load(gradient + i * width + column) : Vec(gradient[i]);
      add_sample(*values, piece, places + 3 * static_cast<std::size_t>(samples[i]), here);
    }
  });
}

}  // namespace ringlight::RINGLIGHT_ISA
