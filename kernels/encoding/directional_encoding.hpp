// Integrated directional encoding (Ref-NeRF, Verbin et al. 2022, section 4): harmonics of the levels 1, 2, 4 and 8 of a
// direction, each level faded as by a roughness (src/ringlight/fields/directional_encoding.py is the reference).
#pragma once

namespace ringlight {

constexpr int HIGHEST_LEVEL = 8;  // level l has l + 1 harmonics, of orders 0 to l
constexpr int CODE_PAIRS = 19;                     // of real and imaginary parts
constexpr int CODE_WIDTH = 2 * CODE_PAIRS;

}  // namespace ringlight
