"""What a network sees of each covered pixel, by one Triton kernel; the way back by another, which keeps nothing.

Surface, reflected ray, its exit from the sphere of each shell, maps and factors of the place are those of
``ReflectionShader.reference``. Sums over pixels of the spheres' and the factors' gradients go to a slab for each
program, as in ``fields/perceptron_triton.py``; those of the maps are atomic additions, in no fixed order.
"""

import triton
import triton.language as tl

from ringlight.core.triton_kernels import VARYING
from ringlight.fields.octahedral_triton import add_to_node, cell_of, node_of

ROWS = 64
"""Pixels a block."""

SPHERE = 4
"""Numbers of a sphere."""


@triton.jit
def _surface(
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
def _exit(p_x, p_y, p_z, r_x, r_y, r_z, sphere, least_chord):
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
def _octahedral(x, y, z, smallest):
    """The square's coordinates, and the inverse of the sum of absolute values."""
    inverse = 1.0 / tl.maximum(tl.abs(x) + tl.abs(y) + tl.abs(z), smallest)
    x, y = x * inverse, y * inverse
    u = tl.where(z >= 0, x, (1 - tl.abs(y)) * tl.where(x >= 0, 1.0, -1.0))
    v = tl.where(z >= 0, y, (1 - tl.abs(x)) * tl.where(y >= 0, 1.0, -1.0))
    return u, v, x, y, inverse


@triton.jit
def _octahedral_gradient(by_u, by_v, z, x, y, inverse):
    """By the three numbers, of which ``x`` and ``y`` are over their sum and ``z`` is not."""
    sign_x = tl.where(x >= 0, 1.0, -1.0)
    sign_y = tl.where(y >= 0, 1.0, -1.0)
    by_x = tl.where(z >= 0, by_u, -by_v * sign_x * sign_y)
    by_y = tl.where(z >= 0, by_v, -by_u * sign_x * sign_y)
    along = by_x * x + by_y * y
    sign_z = tl.where(z >= 0, 1.0, -1.0)
    return (by_x - sign_x * along) * inverse, (by_y - sign_y * along) * inverse, -sign_z * along * inverse


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
def _add_factors(slab, cell, part, first, index, by_factor, NODES: tl.constexpr, PADDED: tl.constexpr,
                 FEATURES: tl.constexpr, ALL: tl.constexpr):  # fmt: skip
    """Adds what each node of one axis gets of ``by_factor`` [B F]."""
    node = tl.arange(0, PADDED)
    steps = node[None, :] - cell[:, None]
    share = tl.where(steps == 0, 1 - part[:, None], tl.where(steps == 1, part[:, None], 0.0))
    total = tl.sum(share[:, :, None] * by_factor[:, None, :], 0)
    place = slab + node[:, None] * ALL + first + index[None, :]
    mask = (node < NODES)[:, None] & (index < FEATURES)[None, :]
    tl.store(place, tl.load(place, mask=mask, other=0.0) + total, mask=mask)


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
    opacity, n_x, n_y, n_z, _inverse, _squared, d_x, d_y, d_z, p_x, p_y, p_z = _surface(
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
            s_x, s_y, s_z, _x, _y, _z, _along, _chord, _distance, _nearness = _exit(
                p_x, p_y, p_z, r_x, r_y, r_z, spheres + shell * 4, least_chord
            )
        u, v, _flat_x, _flat_y, _shrunk = _octahedral(s_x, s_y, s_z, smallest)
        for number in range(LEVELS):
            side, level = tl.load(sides + number), maps + tl.load(starts + shell * LEVELS + number)
            a, b, c, d, _, _, across, down = _map_corners(level, u, v, side, index, known, FEATURES)
            upper = a + (b - a) * across
            feature = upper + (c + (d - c) * across - upper) * down
            first = (shell * LEVELS + number) * FEATURES
            if NODES:
                for axis in tl.static_range(3):
                    cell, part = cell_of(p_x if axis == 0 else p_y if axis == 1 else p_z, NODES)
                    feature *= _factors(axes + axis * NODES * ALL, cell, part, first, index, known, ALL)
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
        opacity, n_x, n_y, n_z, inverse, squared, d_x, d_y, d_z, p_x, p_y, p_z = _surface(
            image, alpha, pixel, mask, view, width, step, faintest_normal, LATENTS, DEPTH
        )
        seen, given, into = inputs + row * INPUTS, upstream + row * INPUTS, grad_image + pixel * CHANNELS
        by_alpha = opacity * 0.0
        for i in tl.static_range(LATENTS):
            by_latent = tl.load(given + 1 + i, mask=mask, other=0.0) / opacity
            tl.store(into + 6 + i, by_latent, mask=mask)
            by_alpha -= by_latent * tl.load(seen + 1 + i, mask=mask, other=0.0)
        for color in tl.static_range(3):
            by_base = tl.load(given + 1 + LATENTS + color, mask=mask, other=0.0) / opacity
            base = tl.load(seen + 1 + LATENTS + color, mask=mask, other=0.0)
            shown = tl.load(by_color + row * 3 + color, mask=mask, other=0.0)
            tl.store(into + color, shown + by_base, mask=mask)
            by_alpha += by_base * (tl.load(view + 16 + color) - base)
            by_alpha += shown * tl.load(added + row * 3 + color, mask=mask, other=0.0)
        tl.store(grad_alpha + pixel, by_alpha, mask=mask)
        facing = d_x * n_x + d_y * n_y + d_z * n_z
        r_x, r_y, r_z = d_x - 2 * facing * n_x, d_y - 2 * facing * n_y, d_z - 2 * facing * n_z
        by_rx, by_ry, by_rz = facing * 0.0, facing * 0.0, facing * 0.0
        for shell in tl.static_range(SHELLS):
            s_x, s_y, s_z = r_x, r_y, r_z
            l_x, l_y, l_z, along, chord, distance, nearness = p_x, p_y, p_z, facing, facing, facing, facing
            if PARALLAX:
                s_x, s_y, s_z, l_x, l_y, l_z, along, chord, distance, nearness = _exit(
                    p_x, p_y, p_z, r_x, r_y, r_z, spheres + shell * 4, least_chord
                )
            u, v, flat_x, flat_y, shrunk = _octahedral(s_x, s_y, s_z, smallest)
            by_u, by_v = facing * 0.0, facing * 0.0
            for number in range(LEVELS):
                side, start = tl.load(sides + number), tl.load(starts + shell * LEVELS + number)
                a, b, c, d, line, column, across, down = _map_corners(maps + start, u, v, side, index, known, FEATURES)
                first = (shell * LEVELS + number) * FEATURES
                by_feature = tl.load(given[:, None] + 4 + LATENTS + first + index[None, :], mask=known, other=0.0)
                if NODES:
                    upper = a + (b - a) * across
                    by_factor = by_feature * (upper + (c + (d - c) * across - upper) * down)
                    x_cell, x_part = cell_of(p_x, NODES)
                    y_cell, y_part = cell_of(p_y, NODES)
                    z_cell, z_part = cell_of(p_z, NODES)
                    x = _factors(axes, x_cell, x_part, first, index, known, ALL)
                    y = _factors(axes + NODES * ALL, y_cell, y_part, first, index, known, ALL)
                    z = _factors(axes + 2 * NODES * ALL, z_cell, z_part, first, index, known, ALL)
                    places = slab + SHELLS * 4
                    _add_factors(places, x_cell, x_part, first, index, by_factor * y * z, NODES, PADDED, FEATURES, ALL)
                    places += NODES * ALL
                    _add_factors(places, y_cell, y_part, first, index, by_factor * x * z, NODES, PADDED, FEATURES, ALL)
                    places += NODES * ALL
                    _add_factors(places, z_cell, z_part, first, index, by_factor * x * y, NODES, PADDED, FEATURES, ALL)
                    by_feature *= x * y * z
                half = 0.5 * (side - 1)
                by_u += half * tl.sum(by_feature * ((b - a) * (1 - down) + (d - c) * down), 1)
                by_v += half * tl.sum(by_feature * ((c - a) * (1 - across) + (d - b) * across), 1)
                level, above, below = grad_maps + start, by_feature * (1 - down), by_feature * down
                add_to_node(level, line, column, side, index, above * (1 - across), known, FEATURES)
                add_to_node(level, line, column + 1, side, index, above * across, known, FEATURES)
                add_to_node(level, line + 1, column, side, index, below * (1 - across), known, FEATURES)
                add_to_node(level, line + 1, column + 1, side, index, below * across, known, FEATURES)
            by_sx, by_sy, by_sz = _octahedral_gradient(by_u, by_v, s_z, flat_x, flat_y, shrunk)
            if PARALLAX:
                by_distance = by_sx * r_x + by_sy * r_y + by_sz * r_z
                by_chord = tl.where(chord > least_chord, by_distance * 0.5 / (distance + along), 0.0)
                by_along = 2 * along * by_chord - by_distance
                by_lx = by_sx + by_along * r_x - 2 * l_x * by_chord
                by_ly = by_sy + by_along * r_y - 2 * l_y * by_chord
                by_lz = by_sz + by_along * r_z - 2 * l_z * by_chord
                by_rx += distance * by_sx + by_along * l_x
                by_ry += distance * by_sy + by_along * l_y
                by_rz += distance * by_sz + by_along * l_z
                into_sphere = slab + shell * 4
                by_log = tl.where(mask, by_lx * l_x + by_ly * l_y + by_lz * l_z, 0.0)
                tl.store(into_sphere, tl.load(into_sphere) - tl.sum(tl.where(mask, by_lx * nearness, 0.0), 0))
                tl.store(into_sphere + 1, tl.load(into_sphere + 1) - tl.sum(tl.where(mask, by_ly * nearness, 0.0), 0))
                tl.store(into_sphere + 2, tl.load(into_sphere + 2) - tl.sum(tl.where(mask, by_lz * nearness, 0.0), 0))
                tl.store(into_sphere + 3, tl.load(into_sphere + 3) + tl.sum(by_log, 0))
            else:
                by_rx, by_ry, by_rz = by_rx + by_sx, by_ry + by_sy, by_rz + by_sz
        turned = -2 * (by_rx * n_x + by_ry * n_y + by_rz * n_z) - tl.load(given, mask=mask, other=0.0)
        by_nx = turned * d_x - 2 * facing * by_rx
        by_ny = turned * d_y - 2 * facing * by_ry
        by_nz = turned * d_z - 2 * facing * by_rz
        stretched = tl.where(squared > faintest_normal, by_nx * n_x + by_ny * n_y + by_nz * n_z, 0.0)
        tl.store(into + 3, (by_nx - stretched * n_x) * inverse, mask=mask)
        tl.store(into + 4, (by_ny - stretched * n_y) * inverse, mask=mask)
        tl.store(into + 5, (by_nz - stretched * n_z) * inverse, mask=mask)
