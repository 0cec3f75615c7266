#include "step/importance_sampling.isa.hpp"
#include "volume/volume.hpp"

namespace ringlight::RINGLIGHT_ISA {

std::size_t volume_draw(const float* gradient, std::size_t count, int width, double share, std::int32_t* rows,
                        float* weights) {
  std::size_t with_gradient = 0;
  for (std::size_t row = 0; row < count; row++) {
    float size = 0.f;
    for (int c = 0; c < width; c++) size += __builtin_fabsf(gradient[row * width + c]);
    rows[with_gradient] = static_cast<std::int32_t>(row);
    weights[with_gradient] = size;
    with_gradient += size != 0.f;
  }
  return sample_measured(share, with_gradient, rows, weights);
}

}  // namespace ringlight::RINGLIGHT_ISA
