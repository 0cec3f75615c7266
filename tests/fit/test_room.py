"""How many rows a machine has memory for."""

from ringlight.fit.room import COPIES, GOOD_COPIES, SHARE, WORK_BYTES, most_rows
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


def test_a_share_of_the_memory_holds_so_many():
    model = METHODS["3dgs"].build(tiny_scene(views=4, size=24), rasterizer_for("auto"), seed=0).model
    row = 4 * (3 + 3 + 4 + 1 + 3 + 45)
    assert most_rows(model, memory=1 << 30) == int(SHARE * (1 << 30)) // (COPIES * row + WORK_BYTES)
    assert most_rows(model, memory=10) == 1
    assert most_rows(model) > 100_000, "on any machine that runs these tests"


def test_a_guard_keeps_a_state_besides():
    model = METHODS["ringlight-ring"].build(tiny_scene(views=4, size=24), rasterizer_for("auto"), seed=0).model
    bytes_of_each = (COPIES + GOOD_COPIES) * model.bytes_each() + WORK_BYTES
    assert most_rows(model, memory=1 << 30, guarded=True) == int(SHARE * (1 << 30)) // bytes_of_each
