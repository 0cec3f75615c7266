"""What a page gets of a rough environment: the maps that the model looks into, of its own light and of each pack's."""

import torch

from ringlight.color.specular_table import specular_table
from ringlight.color.split_sum import SplitSumLight
from ringlight.files.packed import pack_tensors, unpack_tensors
from ringlight.files.page.blurred_light import MAPS, SHARES, STEP, TEXELS, with_maps

SIDE = 32


def texels(seed: int) -> torch.Tensor:
    return 2 * torch.randn(6, SIDE, SIDE, 3, generator=torch.Generator().manual_seed(seed))


def test_maps_and_table_take_the_place_of_texels() -> None:
    light = SplitSumLight(SIDE)
    kept = {"columns.means": torch.rand(5, 3), "color.lit": torch.tensor(True)}
    packed = pack_tensors({TEXELS: texels(1), f"light.0.{TEXELS}": texels(2), **kept})
    before = unpack_tensors(packed)
    found = unpack_tensors(with_maps(packed, light))
    assert found.keys() == {MAPS, f"light.0.{MAPS}", SHARES, *kept}
    for name in kept:
        assert torch.equal(found[name], before[name])
    for prefix in ("", "light.0."):
        bordered = light.maps_of(before[prefix + TEXELS])
        at = row = 0
        for side in (level.side for level in light.levels):
            wide = side + 2
            own = bordered[row : row + 6 * wide * wide].view(6, wide, wide, 3)[:, 1:-1, 1:-1]
            seen = found[prefix + MAPS][at : at + 6 * side * side].view(6, side, side, 3)
            assert (seen - own).abs().max() <= STEP / 2 + 1e-6
            at, row = at + 6 * side * side, row + 6 * wide * wide
        assert (at, row) == (len(found[prefix + MAPS]), len(bordered))
    assert (found[SHARES].T.view_as(specular_table()) - specular_table()).abs().max() <= STEP / 2 + 1e-6
