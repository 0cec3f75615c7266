// A shader as Python hands it to the rasterizer, whoever made it.
#pragma once
#include <cstddef>

#include "raster/tile_shader.hpp"

namespace ringlight {

struct PictureShader {
  virtual ~PictureShader() = default;
  virtual const TileShader& shader() const = 0;
  virtual std::size_t channels() const = 0;  // what it takes
};

}  // namespace ringlight
