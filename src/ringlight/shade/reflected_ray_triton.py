"""A covered pixel's surface, its reflected ray's exit from a sphere and the octahedral square, in Triton's language.

Parts of ``shade/reflection_triton.py``. The references are ``shade/covered.py``, ``fields/parallax.py`` and
``octahedral_from_directions``.
"""

import triton
import triton.language as tl


@triton.jit
def surface_of(
    image, alpha, pixel, mask, view, width, step, faintest_normal, LATENTS: tl.constexpr, DEPTH: tl.constexpr
):  # fmt: skip
    """Opacity, unit normal with its inverse length and square, ray, and the surface's point in halves of the box.

    ``view`` holds focal lengths 0, centre 2, rotation 4, position 13, background 16, the box's middle 19, scale 22.
    """
    at = image + pixel * step
    opacity = tl.load(alpha + pixel, mask=mask, other=1.0)
    n_x = tl.load(at + 3, mask=mask, other=1.0)
    n_y = tl.load(at + 4, mask=mask, other=0.0)
    n_z = tl.load(at + 5, mask=mask, other=0.0)
    squared = n_x * n_x + n_y * n_y + n_z * n_z
    inverse = 1.0 / tl.sqrt(tl.maximum(squared, faintest_normal))
    line = pixel // width
    across = ((pixel - line * width).to(tl.float32) + 0.5 - tl.load(view + 2)) / tl.load(view)
    down = (line.to(tl.float32) + 0.5 - tl.load(view + 3)) / tl.load(view + 1)
    x = across * tl.load(view + 4) + down * tl.load(view + 7) + tl.load(view + 10)
    y = across * tl.load(view + 5) + down * tl.load(view + 8) + tl.load(view + 11)
    z = across * tl.load(view + 6) + down * tl.load(view + 9) + tl.load(view + 12)
    scale = tl.load(view + 22)
    depth = opacity * 0.0
    if DEPTH:
        depth = tl.load(at + 6 + LATENTS, mask=mask, other=0.0) / opacity
    p_x = (tl.load(view + 13) + x * depth - tl.load(view + 19)) * scale
    p_y = (tl.load(view + 14) + y * depth - tl.load(view + 20)) * scale
    p_z = (tl.load(view + 15) + z * depth - tl.load(view + 21)) * scale
    near = 1.0 / tl.sqrt(x * x + y * y + z * z)
    return (
        opacity, n_x * inverse, n_y * inverse, n_z * inverse, inverse, squared,
        x * near, y * near, z * near, p_x, p_y, p_z,
    )  # fmt: skip


@triton.jit
def exit_of(p_x, p_y, p_z, r_x, r_y, r_z, sphere, least_chord):
    """From the sphere's centre to where the ray leaves it, in radii; what the way back needs besides."""
    inverse = tl.exp(tl.load(sphere + 3))
    x = (p_x - tl.load(sphere)) * inverse
    y = (p_y - tl.load(sphere + 1)) * inverse
    z = (p_z - tl.load(sphere + 2)) * inverse
    along = x * r_x + y * r_y + z * r_z
    chord = along * along - (x * x + y * y + z * z) + 1.0
    distance = tl.sqrt(tl.maximum(chord, least_chord)) - along
    return x + distance * r_x, y + distance * r_y, z + distance * r_z, x, y, z, along, chord, distance, inverse


@triton.jit
def octahedral_of(x, y, z, smallest):
    """The square's coordinates, and the inverse of the sum of absolute values."""
    inverse = 1.0 / tl.maximum(tl.abs(x) + tl.abs(y) + tl.abs(z), smallest)
    x, y = x * inverse, y * inverse
    u = tl.where(z >= 0, x, (1 - tl.abs(y)) * tl.where(x >= 0, 1.0, -1.0))
    v = tl.where(z >= 0, y, (1 - tl.abs(x)) * tl.where(y >= 0, 1.0, -1.0))
    return u, v, x, y, inverse


@triton.jit
def octahedral_gradient(by_u, by_v, z, x, y, inverse):
    """By the three numbers, of which ``x`` and ``y`` are over their sum and ``z`` is not."""
    sign_x = tl.where(x >= 0, 1.0, -1.0)
    sign_y = tl.where(y >= 0, 1.0, -1.0)
    by_x = tl.where(z >= 0, by_u, -by_v * sign_x * sign_y)
    by_y = tl.where(z >= 0, by_v, -by_u * sign_x * sign_y)
    along = by_x * x + by_y * y
    sign_z = tl.where(z >= 0, 1.0, -1.0)
    return (by_x - sign_x * along) * inverse, (by_y - sign_y * along) * inverse, -sign_z * along * inverse


@triton.jit
def exit_gradient(
    by_x, by_y, by_z, r_x, r_y, r_z, l_x, l_y, l_z, along, chord, distance, nearness, slab, mask, least_chord
):
    """By the ray's direction; what the sphere gets is added to its four numbers of the slab."""
    by_distance = by_x * r_x + by_y * r_y + by_z * r_z
    by_chord = tl.where(chord > least_chord, by_distance * 0.5 / (distance + along), 0.0)
    by_along = 2 * along * by_chord - by_distance
    by_lx = tl.where(mask, by_x + by_along * r_x - 2 * l_x * by_chord, 0.0)
    by_ly = tl.where(mask, by_y + by_along * r_y - 2 * l_y * by_chord, 0.0)
    by_lz = tl.where(mask, by_z + by_along * r_z - 2 * l_z * by_chord, 0.0)
    tl.store(slab, tl.load(slab) - tl.sum(by_lx * nearness, 0))
    tl.store(slab + 1, tl.load(slab + 1) - tl.sum(by_ly * nearness, 0))
    tl.store(slab + 2, tl.load(slab + 2) - tl.sum(by_lz * nearness, 0))
    tl.store(slab + 3, tl.load(slab + 3) + tl.sum(by_lx * l_x + by_ly * l_y + by_lz * l_z, 0))
    return distance * by_x + by_along * l_x, distance * by_y + by_along * l_y, distance * by_z + by_along * l_z
