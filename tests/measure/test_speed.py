"""Speed: what is timed, how often, and that a slow back end gets its number."""

import torch

from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.measure.speed import copy_bandwidth, frames_per_second, peak_gflops

CAMERA = Camera(torch.eye(4), (10.0, 10.0), (4.0, 3.0), 8, 6)


class Counter:
    """Renders black and remembers how often, and whether gradients were on."""

    def __init__(self):
        self.calls, self.with_gradients = 0, False

    def __call__(self, camera):
        self.calls += 1
        self.with_gradients |= torch.is_grad_enabled()
        return Rendering(torch.zeros(camera.height, camera.width, 3), torch.zeros(camera.height, camera.width, 1))


def test_all_cameras_are_timed_after_warming_up():
    render = Counter()
    rate = frames_per_second(render, [CAMERA] * 4)
    assert render.calls == 1 + (1 + 3) * 4
    assert not render.with_gradients
    assert rate.fps > 0
    assert "4 views of 8x6" in rate.note
    assert "3 passes" in rate.note


def test_one_pass_is_timed_however_slow(monkeypatch):
    monkeypatch.setattr("ringlight.measure.speed.MAX_SECONDS", 0.0)
    render = Counter()
    rate = frames_per_second(render, [CAMERA])
    assert render.calls == 3
    assert "1 pass " in rate.note


def test_a_slow_back_end_is_timed_with_as_many_views_as_it_shows_in_time(monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr("ringlight.measure.speed.time.perf_counter", lambda: float(next(clock)))  # a second a look
    monkeypatch.setattr("ringlight.measure.speed.WARM_SECONDS", 2.0)
    monkeypatch.setattr("ringlight.measure.speed.MAX_SECONDS", 5.0)
    seen = []

    def render(camera):
        seen.append(camera.width)
        return Rendering(torch.zeros(camera.height, camera.width, 3), torch.zeros(camera.height, camera.width, 1))

    cameras = [Camera(torch.eye(4), (10.0, 10.0), (4.0, 3.0), 10 + k, 6) for k in range(10)]
    rate = frames_per_second(render, cameras)
    assert seen == [10, 10, 11, 10, 12, 14, 16, 18]
    assert rate.fps == 5.0
    assert "5 views of 10x6 to 18x6" in rate.note
    assert "1 pass after 2 views to warm up" in rate.note


def test_the_machine_has_some_speed():
    assert peak_gflops() > 0
    assert copy_bandwidth() > 0
