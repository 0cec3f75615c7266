// The rasterizer: stages in order, and the memory between them.
#pragma once
#include "machine/buffer.hpp"
#include "raster/bin.hpp"
#include "raster/raster.hpp"
#include "raster/sort.hpp"

namespace ringlight {

enum Stage { PROJECT, SORT, BIN, BLEND, BLEND_GRADIENT, PROJECT_GRADIENT, STAGES };

// Holds what one forward pass leaves for its backward pass. Reused by later passes, it allocates only to grow.
class Workspace {
 public:
  // Fills in `images` and `footprints` completely. Throws std::bad_alloc (nothing is drawn) when the entries of this
  // view would not fit into the memory of the machine, std::domain_error when the table, or a lazy colour that was
  // asked for, holds a value that is not finite. No backward pass can follow an early stop, a shader without
  // `blended`, or lazy colours that are not kept.
  void forward(const Camera& camera, const RasterSettings& settings, const Splats& splats, const Images& images,
               const Footprints& footprints, const LazyColors* lazy = nullptr);

  // Fills in `to` for the last forward pass; `splats` must hold the same values as then.
  void backward(const Splats& splats, const ImageGradients& from, const SplatGradients& to);

  // Whether a backward pass can follow the last forward pass.
  bool complete() const { return complete_; }
  const View& view() const { return view_; }
  // How long each stage took the last time.
  double seconds(Stage stage) const { return seconds_[stage]; }

 private:
  void make_room();
  std::uint64_t number_slots();
  void reserve_scratch(std::size_t of_shader);

  View view_{};
  double seconds_[STAGES] = {};
  bool complete_ = false, lazy_broken_ = false;
  std::uint64_t slots_in_use_ = 0;
  DepthSort sort_;
  Binning binning_;
  Buffer<float> records_, final_transmittance_, slots_, scratch_;
  Buffer<std::uint32_t> tile_used_;
  Buffer<Placement> placements_;
  Buffer<Piece> pieces_;
  Buffer<std::uint64_t> block_masks_;
  Buffer<std::uint8_t> slot_used_;
};

}  // namespace ringlight
