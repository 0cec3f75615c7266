"""How many Gaussians a mirror takes."""

from ringlight.methods.mirror_bounds import most_gaussians, most_without_hull


def test_large_photographs_get_fewer_gaussians_than_pixels():
    assert [most_gaussians(pixels, 50) for pixels in (500, 40_000, 140_000)] == [500, 10_000, 20_000]
    assert [most_gaussians(40_000, views) for views in (1, 70, 100, 1000)] == [10_000, 14_000, 20_000, 20_000]
    assert most_gaussians(15_000, 100) == 15_000
    assert most_gaussians(160_000, 100) == 22_858


def test_where_no_hull_cuts_the_subject_out_it_follows_the_pixels_alone():
    assert [most_without_hull(pixels) for pixels in (500, 12_000, 131_760)] == [500, 10_000, 98_820]
