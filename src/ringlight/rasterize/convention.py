"""Every number that the back ends must share, each with its reason. CMake generates kernels/convention.hpp from here.

The semantics are gsplat's (Apache-2.0, version 1.5.3), so that a model means the same on every back end.
"""

MIN_ALPHA = 1 / 255
"""A weaker contribution cannot change an 8-bit pixel and is skipped."""

MAX_ALPHA = 0.999
"""Full opacity would make the backward pass divide by zero. 3DGS and gsplat 1.6 use 0.99."""

MIN_TRANSMITTANCE = 1e-4
"""Blending stops *before* the Gaussian that would bring the transmittance to this or below."""

EARLY_STOP = 1 / 64
"""A block that may stop early does so once less than this of what lies behind shows through each of its pixels; what is
in front stands for the rest. Pictures of trained scenes then differ by a step of 8 bits or less, root mean square over
test views: docs/experiments/pictures-early-stop.md has what other values cost and save."""

EPS2D = 0.3
"""Square pixels added to the diagonal of the 2-D covariance: a splat never falls between the pixel centres."""

NEAR = 0.01
"""World units; nearer centres are culled before the projection blows up."""

FRUSTUM_MARGIN = 0.3
"""x/z and y/z are clamped to the image plus this share of tan(fov/2), which bounds the affine approximation's error."""

MAX_SIGMAS = 3.33
"""The footprint reaches at most this many standard deviations (gsplat 1.5.3): exp(-3.33^2 / 2) is 1/255."""

LOG2_E = 1.4426950408889634
"""exp(x) = exp2(x * LOG2_E): the kernels work in base two."""
