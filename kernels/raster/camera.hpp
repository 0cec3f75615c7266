// One pinhole view of the world, as every kernel is told of it.
#pragma once

namespace ringlight {

// Lengths on the image in pixels, pixel centres at .5; all else in world units.
struct Camera {
  float world_to_camera[12];  // upper three rows, row-major; x right, y down, z forward
  float position[3];          // the optical centre: handed in, so that one rounding of it serves all
  float focal_x, focal_y, center_x, center_y;
  int width, height;
};

}  // namespace ringlight
