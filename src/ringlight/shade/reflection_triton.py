"""What a network sees of each covered pixel, by one Triton kernel; the way back by another, which keeps nothing.

Surface, reflected ray, its exit from the sphere of each shell, maps and factors of the place are those of
``ReflectionShader.reference``. Sums over pixels of the spheres' and the factors' gradients go to a slab for each
program, as in ``fields/perceptron_triton.py``; those of the maps are atomic additions, in no fixed order.
"""

import triton
import triton.language as tl

from ringlight.core.triton_kernels import VARYING
from ringlight.fields.octahedral_triton import add_to_node, cell_of, node_of
from ringlight.shade.reflected_ray_triton import exit_gradient, exit_of, octahedral_gradient, octahedral_of, surface_of

ROWS = 64
"""Pixels a block."""

LAUNCH = {"num_stages": 1}
"""As in ``color/shared_basis_triton.py``: slabs are read and written in turns."""

SPHERE = 4
"""Numbers of a sphere."""


@triton.jit
def _map_corners(level, u, v, side, index, mask, FEATURES: tl.constexpr):
    """Features [B F] at the four nodes around each place, and where it lies between them."""
    column, across = cell_of(u, side)
    line, down = cell_of(v, side)
    a = node_of(level, line, column, side, index, mask, FEATURES)
    b = node_of(level, line, column + 1, side, index, mask, FEATURES)
    c = node_of(level, line + 1, column, side, index, mask, FEATURES)
    d = node_of(level, line + 1, column + 1, side, index, mask, FEATURES)
    return a, b, c, d, line, column, across[:, None], down[:, None]


@triton.jit
def _factors(axes, cell, part, first, index, mask, ALL: tl.constexpr):
    """Factors [B F] of one axis between two nodes, from feature ``first`` on."""
    at = axes + cell[:, None] * ALL + first + index[None, :]
    low = tl.load(at, mask=mask, other=0.0)
    return low + (tl.load(at + ALL, mask=mask, other=0.0) - low) * part[:, None]


@triton.jit
def _add_factors(
    slab, coordinate, first, index, by_factor,
    NODES: tl.constexpr, PADDED: tl.constexpr, FEATURES: tl.constexpr, ALL: tl.constexpr,
):  # fmt: skip
    """Adds what each node of one axis gets of ``by_factor`` [B F]."""
    cell, part = cell_of(coordinate, NODES)
    node = tl.arange(0, PADDED)
    steps = node[None, :] - cell[:, None]
    share = tl.where(steps == 0, 1 - part[:, None], tl.where(steps == 1, part[:, None], 0.0))
    total = tl.sum(share[:, :, None] * by_factor[:, None, :], 0)
    place = slab + node[:, None] * ALL + first + index[None, :]
    mask = (node < NODES)[:, None] & (index < FEATURES)[None, :]
    tl.store(place, tl.load(place, mask=mask, other=0.0) + total, mask=mask)


@triton.jit
def _product(axes, p_x, p_y, p_z, first, index, mask, NODES: tl.constexpr, ALL: tl.constexpr):
    """The three axes' factors of the place, [B F] each."""
    x_cell, x_part = cell_of(p_x, NODES)
    y_cell, y_part = cell_of(p_y, NODES)
    z_cell, z_part = cell_of(p_z, NODES)
    x = _factors(axes, x_cell, x_part, first, index, mask, ALL)
    y = _factors(axes + NODES * ALL, y_cell, y_part, first, index, mask, ALL)
    z = _factors(axes + 2 * NODES * ALL, z_cell, z_part, first, index, mask, ALL)
    return x, y, z


@triton.jit
def _blended_gradient(
    inputs, upstream, added, by_color, view, into, opacity, mask, LATENTS: tl.constexpr
):  # fmt: skip
    """Writes what the blended colour and latents get; returns what the opacity does."""
    by_alpha = opacity * 0.0
    for i in tl.static_range(LATENTS):
        by_latent = tl.load(upstream + 1 + i, mask=mask, other=0.0) / opacity
        tl.store(into + 6 + i, by_latent, mask=mask)
        by_alpha -= by_latent * tl.load(inputs + 1 + i, mask=mask, other=0.0)
    for color in tl.static_range(3):
        by_base = tl.load(upstream + 1 + LATENTS + color, mask=mask, other=0.0) / opacity
        base = tl.load(inputs + 1 + LATENTS + color, mask=mask, other=0.0)
        shown = tl.load(by_color + color, mask=mask, other=0.0)
        tl.store(into + color, shown + by_base, mask=mask)
        by_alpha += by_base * (tl.load(view + 16 + color) - base)
        by_alpha += shown * tl.load(added + color, mask=mask, other=0.0)
    return by_alpha


@triton.jit
def _normal_gradient(
    by_rx, by_ry, by_rz, by_cosine, d_x, d_y, d_z, n_x, n_y, n_z, inverse, squared, shortest, into, mask
):
    """Writes what the blended normal gets of the reflected ray's gradient and the cosine's."""
    facing = d_x * n_x + d_y * n_y + d_z * n_z
    turned = -2 * (by_rx * n_x + by_ry * n_y + by_rz * n_z) - by_cosine
    by_nx = turned * d_x - 2 * facing * by_rx
    by_ny = turned * d_y - 2 * facing * by_ry
    by_nz = turned * d_z - 2 * facing * by_rz
    stretched = tl.where(squared > shortest, by_nx * n_x + by_ny * n_y + by_nz * n_z, 0.0)
    tl.store(into, (by_nx - stretched * n_x) * inverse, mask=mask)
    tl.store(into + 1, (by_ny - stretched * n_y) * inverse, mask=mask)
    tl.store(into + 2, (by_nz - stretched * n_z) * inverse, mask=mask)


@triton.jit
def _level_gradient(
    level, grad_level, axes, slab, given, u, v, p_x, p_y, p_z, side, first, index, mask,
    FEATURES: tl.constexpr, NODES: tl.constexpr, PADDED: tl.constexpr, ALL: tl.constexpr,
):  # fmt: skip
    """By the square's coordinates; adds to the level's nodes, and to the slab what the factors get."""
    a, b, c, d, line, column, across, down = _map_corners(level, u, v, side, index, mask, FEATURES)
    by_feature = tl.load(given[:, None] + first + index[None, :], mask=mask, other=0.0)
    if NODES:
        upper = a + (b - a) * across
        by_factor = by_feature * (upper + (c + (d - c) * across - upper) * down)
        x, y, z = _product(axes, p_x, p_y, p_z, first, index, mask, NODES, ALL)
        _add_factors(slab, p_x, first, index, by_factor * y * z, NODES, PADDED, FEATURES, ALL)
        _add_factors(slab + NODES * ALL, p_y, first, index, by_factor * x * z, NODES, PADDED, FEATURES, ALL)
        _add_factors(slab + 2 * NODES * ALL, p_z, first, index, by_factor * x * y, NODES, PADDED, FEATURES, ALL)
        by_feature *= x * y * z
    above, below = by_feature * (1 - down), by_feature * down
    add_to_node(grad_level, line, column, side, index, above * (1 - across), mask, FEATURES)
    add_to_node(grad_level, line, column + 1, side, index, above * across, mask, FEATURES)
    add_to_node(grad_level, line + 1, column, side, index, below * (1 - across), mask, FEATURES)
    add_to_node(grad_level, line + 1, column + 1, side, index, below * across, mask, FEATURES)
    half = 0.5 * (side - 1)
    by_u = half * tl.sum(by_feature * ((b - a) * (1 - down) + (d - c) * down), 1)
    by_v = half * tl.sum(by_feature * ((c - a) * (1 - across) + (d - b) * across), 1)
    return by_u, by_v


@triton.jit(do_not_specialize=VARYING)
def read_surface(
    image, alpha, pixels, view, maps, sides, starts, spheres, axes, inputs,
    count, width, step, faintest_normal, least_chord, smallest,
    LATENTS: tl.constexpr, SHELLS: tl.constexpr, LEVELS: tl.constexpr, FEATURES: tl.constexpr, WIDE: tl.constexpr,
    PARALLAX: tl.constexpr, NODES: tl.constexpr, DEPTH: tl.constexpr, RAW: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Writes ``inputs`` [P I]: cosine, latents, base colour, features shell by shell, the ray's direction if RAW."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    pixel = tl.load(pixels + row, mask=mask, other=0).to(tl.int32)
    ALL: tl.constexpr = SHELLS * LEVELS * FEATURES
    INPUTS: tl.constexpr = 4 + LATENTS + ALL + 3 * RAW
    opacity, n_x, n_y, n_z, _inverse, _squared, d_x, d_y, d_z, p_x, p_y, p_z = surface_of(
        image, alpha, pixel, mask, view, width, step, faintest_normal, LATENTS, DEPTH
    )
    at, into = image + pixel * step, inputs + row * INPUTS
    facing = d_x * n_x + d_y * n_y + d_z * n_z
    tl.store(into, -facing, mask=mask)
    for i in tl.static_range(LATENTS):
        tl.store(into + 1 + i, tl.load(at + 6 + i, mask=mask, other=0.0) / opacity, mask=mask)
    for color in tl.static_range(3):
        seen = tl.load(at + color, mask=mask, other=0.0) - (1 - opacity) * tl.load(view + 16 + color)
        tl.store(into + 1 + LATENTS + color, seen / opacity, mask=mask)
    if RAW:
        tl.store(into + 4 + LATENTS + ALL, d_x, mask=mask)
        tl.store(into + 5 + LATENTS + ALL, d_y, mask=mask)
        tl.store(into + 6 + LATENTS + ALL, d_z, mask=mask)
    r_x, r_y, r_z = d_x - 2 * facing * n_x, d_y - 2 * facing * n_y, d_z - 2 * facing * n_z
    index = tl.arange(0, WIDE)
    known = mask[:, None] & (index < FEATURES)[None, :]
    for shell in tl.static_range(SHELLS):
        s_x, s_y, s_z = r_x, r_y, r_z
        if PARALLAX:
            s_x, s_y, s_z, _x, _y, _z, _along, _chord, _distance, _nearness = exit_of(
                p_x, p_y, p_z, r_x, r_y, r_z, spheres + shell * 4, least_chord
            )
        u, v, _flat_x, _flat_y, _shrunk = octahedral_of(s_x, s_y, s_z, smallest)
        for number in range(LEVELS):
            side, level = tl.load(sides + number), maps + tl.load(starts + shell * LEVELS + number)
            a, b, c, d, _, _, across, down = _map_corners(level, u, v, side, index, known, FEATURES)
            upper = a + (b - a) * across
            feature = upper + (c + (d - c) * across - upper) * down
            first = (shell * LEVELS + number) * FEATURES
            if NODES:
                x, y, z = _product(axes, p_x, p_y, p_z, first, index, known, NODES, ALL)
                feature *= x * y * z
            tl.store(into[:, None] + 4 + LATENTS + first + index[None, :], feature, mask=known)


@triton.jit(do_not_specialize=VARYING)
def read_surface_gradient(
    image, alpha, pixels, view, maps, sides, starts, spheres, axes, inputs, upstream, added, by_color,
    grad_image, grad_alpha, grad_maps, slabs,
    count, width, step, faintest_normal, least_chord, smallest,
    LATENTS: tl.constexpr, SHELLS: tl.constexpr, LEVELS: tl.constexpr, FEATURES: tl.constexpr, WIDE: tl.constexpr,
    PARALLAX: tl.constexpr, NODES: tl.constexpr, PADDED: tl.constexpr, DEPTH: tl.constexpr, RAW: tl.constexpr,
    B: tl.constexpr,
):  # fmt: skip
    """Writes the covered pixels' rows of ``grad_image`` [H W C] and ``grad_alpha``, adds to ``grad_maps``.

    ``upstream`` [P I] is by ``inputs``, ``added`` [P 3] what the network said, ``by_color`` [P 3] the picture's
    gradient there. A slab holds 4 numbers a sphere, then the axes' factors.
    """
    ALL: tl.constexpr = SHELLS * LEVELS * FEATURES
    INPUTS: tl.constexpr = 4 + LATENTS + ALL + 3 * RAW
    CHANNELS: tl.constexpr = 6 + LATENTS + DEPTH
    slab = slabs + tl.program_id(0) * (SHELLS * 4 + 3 * NODES * ALL)
    index = tl.arange(0, WIDE)
    for begin in range(tl.program_id(0) * B, count, tl.num_programs(0) * B):
        row = begin + tl.arange(0, B)
        mask = row < count
        known = mask[:, None] & (index < FEATURES)[None, :]
        pixel = tl.load(pixels + row, mask=mask, other=0).to(tl.int32)
        opacity, n_x, n_y, n_z, inverse, squared, d_x, d_y, d_z, p_x, p_y, p_z = surface_of(
            image, alpha, pixel, mask, view, width, step, faintest_normal, LATENTS, DEPTH
        )
        given, into = upstream + row * INPUTS, grad_image + pixel * CHANNELS
        by_alpha = _blended_gradient(
            inputs + row * INPUTS, given, added + row * 3, by_color + row * 3, view, into, opacity, mask, LATENTS
        )
        tl.store(grad_alpha + pixel, by_alpha, mask=mask)
        facing = d_x * n_x + d_y * n_y + d_z * n_z
        r_x, r_y, r_z = d_x - 2 * facing * n_x, d_y - 2 * facing * n_y, d_z - 2 * facing * n_z
        by_rx, by_ry, by_rz = facing * 0.0, facing * 0.0, facing * 0.0
        for shell in tl.static_range(SHELLS):
            s_x, s_y, s_z = r_x, r_y, r_z
            if PARALLAX:
                s_x, s_y, s_z, l_x, l_y, l_z, along, chord, distance, nearness = exit_of(
                    p_x, p_y, p_z, r_x, r_y, r_z, spheres + shell * 4, least_chord
                )
            u, v, flat_x, flat_y, shrunk = octahedral_of(s_x, s_y, s_z, smallest)
            by_u, by_v = facing * 0.0, facing * 0.0
            for number in range(LEVELS):
                side, start = tl.load(sides + number), tl.load(starts + shell * LEVELS + number)
                of_u, of_v = _level_gradient(
                    maps + start, grad_maps + start, axes, slab + SHELLS * 4, given + 4 + LATENTS, u, v, p_x, p_y, p_z,
                    side, (shell * LEVELS + number) * FEATURES, index, known, FEATURES, NODES, PADDED, ALL,
                )  # fmt: skip
                by_u += of_u
                by_v += of_v
            by_x, by_y, by_z = octahedral_gradient(by_u, by_v, s_z, flat_x, flat_y, shrunk)
            if PARALLAX:
                by_x, by_y, by_z = exit_gradient(
                    by_x, by_y, by_z, r_x, r_y, r_z, l_x, l_y, l_z, along, chord, distance, nearness,
                    slab + shell * 4, mask, least_chord,
                )  # fmt: skip
            by_rx, by_ry, by_rz = by_rx + by_x, by_ry + by_y, by_rz + by_z
        by_cosine = tl.load(given, mask=mask, other=0.0)
        _normal_gradient(
            by_rx, by_ry, by_rz, by_cosine, d_x, d_y, d_z, n_x, n_y, n_z, inverse, squared, faintest_normal,
            into + 3, mask,
        )  # fmt: skip
