from ringlight.bench.stages import fastest_stages, line
from ringlight.bench.workload import Size


def test_every_stage_is_timed_in_order():
    stages = fastest_stages(Size(500, 48), rounds=2)
    assert list(stages) == ["project", "sort", "bin", "blend", "blend_gradient", "project_gradient"]
    assert all(milliseconds > 0 for milliseconds in stages.values())


def test_a_row_ends_with_the_sum():
    assert line("1@2", {"sort": 0.5, "bin": 0.25}) == "| 1@2 | 0.50 | 0.25 | 0.75 |\n"
