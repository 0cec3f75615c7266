"""Tiles, and the largest sizes that the compiled kernels take. CMake writes both into convention.hpp for C++.

Numbers alone: settings are checked by them before the compiled module, or torch, is imported.
"""

TILE = 32
"""Pixels on a side of a tile: 8 x 8 blocks of 4 x 4 pixels, so that one 64-bit mask covers a tile."""

BLOCK = 4
"""Pixels on a side of a block: 16 lanes, one AVX-512 register or two AVX2 registers."""

MAX_IMAGE_SIDE = 8192
"""Pixels."""

SH_MAX_BASIS = 16
"""Rows of a shared basis of harmonics."""

RING_MAX_RANK = 32
"""Rows of a matrix of the ring."""
RING_MAX_FEATURES = 64
RING_MAX_HIDDEN = 128
"""Width of the light field's hidden layers."""
RING_MAX_NODES = 65536
"""On an axis, and on a side of the octahedral map: a node's number must be exact as a float."""
RING_MAX_LATENTS = 16
"""Values of a Gaussian's own."""

REFLECTION_MAX_HIDDEN = 128
REFLECTION_MAX_LATENTS = 16
REFLECTION_MAX_FEATURES = 16
REFLECTION_MAX_SHELLS = 2
REFLECTION_MAX_LAYERS = 3
"""Of weights: one more than hidden layers."""
REFLECTION_QUAD = 4
"""Features of a map are read in fours."""
REFLECTION_MAX_LEVELS = 8
REFLECTION_MAX_SIDE = 1024
"""Nodes on a side of a map, or on an axis."""

MIRROR_MAX_LATENTS = 9
"""A row's channels, rgb, normal, depth and these, fill one register."""

ENVIRONMENT_MAX_SIDE = 1024
"""Texels on a side of a cubemap's face: a texel's number must be exact as a float."""

SHADED_MAX_LEVELS = 12
"""Blurred maps, by roughness, of the environment that Gaussians are shaded under one by one."""

PLANES_MAX_SIDE = 4096
"""Nodes on an axis of a plane or line."""
PLANES_MAX_CHANNELS = 1024

VOLUME_MOST_NODES = 4096
"""Along an axis of a volume's grid."""
VOLUME_MOST_CELLS = 160
"""Along an axis, of which a bit says whether they are empty: half a megabyte, which stays in a core's cache."""
VOLUME_CELLS_A_BYTE = 8
VOLUME_MOST_COMPONENTS = 4096
VOLUME_COMPONENT_LANES = 16
"""Kernels of planes and lines take whole multiples."""
VOLUME_MOST_UNITS = 8192
"""Of the network's inputs and layers."""
VOLUME_FREQUENCIES = 2
"""Of sines and cosines, 1 and 2, of features and of directions alike."""
VOLUME_SMALLEST_STEP = 1e-9
"""Of a direction along an axis: rays that are parallel to a side of the box."""

TRAIN_MOST_LEVELS = 10
"""Of a tensor train: 2 to this power nodes along each axis."""
TRAIN_MOST_RANK = 4096
