"""Evaluation: every view once, without gradients, means and pooled error, pictures handed out."""

import math

import numpy as np
import pytest
import torch
from samples import NO_LPIPS, sample_report

from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.core.scene import View
from ringlight.errors import SceneError
from ringlight.measure import evaluate as module
from ringlight.measure.evaluate import evaluate
from ringlight.measure.json_record import from_json, to_json
from ringlight.measure.report import Report

WHITE = torch.ones(3)
TRUTH_LEVEL = 102  # of 255: 0.4


def camera(width=24, height=20):
    return Camera(torch.eye(4), (20.0, 20.0), (width / 2, height / 2), width, height)


def view(name="r_0", **size):
    shot = camera(**size)
    return View(name, shot, lambda: np.full((shot.height, shot.width, 3), TRUTH_LEVEL, dtype=np.uint8))


def constant(*levels):
    """Renders these grey levels, one after the other."""
    remaining = list(levels)

    def render(shot):
        color = torch.full((shot.height, shot.width, 3), remaining.pop(0))
        return Rendering(color, torch.ones(shot.height, shot.width, 1))

    return render


def decibel(error):
    return -20 * math.log10(error)


@pytest.fixture(autouse=True)
def without_weights(monkeypatch):
    """Whether the tests find LPIPS weights must not depend on this machine."""
    monkeypatch.setattr(module, "weights_status", lambda net: NO_LPIPS)


def test_means_are_over_images_and_the_pooled_psnr_is_not():
    scores = evaluate(constant(0.5, 0.6), [view("a"), view("b")], WHITE)
    assert [image.name for image in scores.images] == ["a", "b"]
    assert scores.images[0].psnr == pytest.approx(decibel(0.1), abs=1e-3)
    assert scores.psnr == pytest.approx((decibel(0.1) + decibel(0.2)) / 2, abs=1e-3)
    assert scores.psnr_pooled == pytest.approx(-10 * math.log10((0.01 + 0.04) / 2), abs=1e-3)
    assert scores.psnr_pooled < scores.psnr


def test_renders_are_clamped_and_handed_out_with_their_truth():
    kept = []
    evaluate(constant(7.0), [view()], WHITE, keep_images=lambda *found: kept.append(found))
    shown, image, truth = kept[0]
    assert shown.name == "r_0"
    assert (image == 1).all()
    assert torch.allclose(truth, torch.full((20, 24, 3), 0.4))


def test_a_perfect_render_is_infinite_everywhere():
    scores = evaluate(constant(TRUTH_LEVEL / 255), [view()], WHITE)
    assert scores.psnr == scores.psnr_u8 == scores.psnr_pooled == math.inf
    assert scores.ssim_same == pytest.approx(1)


def test_an_undefined_render_is_told_not_hidden():
    assert math.isnan(evaluate(constant(math.nan), [view()], WHITE).psnr_pooled)


def test_the_photograph_lies_over_the_background():
    transparent = View("r", camera(), lambda: np.zeros((20, 24, 4), dtype=np.uint8), has_alpha=True)
    assert evaluate(constant(1.0), [transparent], WHITE).psnr == math.inf
    assert evaluate(constant(1.0), [transparent], torch.zeros(3)).psnr == pytest.approx(0)


def test_no_gradients_are_recorded_and_progress_is_told():
    weight = torch.ones(1, requires_grad=True)
    recorded, told = [], []

    def render(shot):
        color = weight * torch.ones(shot.height, shot.width, 3)
        recorded.append(color.requires_grad)
        return Rendering(color, torch.ones(shot.height, shot.width, 1))

    evaluate(render, [view(), view()], WHITE, progress=lambda done, total: told.append((done, total)))
    assert recorded == [False, False]
    assert told == [(1, 2), (2, 2)]


def test_missing_weights_leave_lpips_open_and_name_the_remedy():
    scores = evaluate(constant(0.5), [view()], WHITE, lpips_nets=("alex", "vgg"))
    assert scores.lpips_alex is scores.lpips_vgg is scores.lpips_vgg_01 is None
    assert NO_LPIPS in scores.lpips_note
    assert evaluate(constant(0.5), [view()], WHITE, lpips_nets=()).lpips_note == ""


class FixedDistance:
    """Stands for a net with weights: tells which range it was asked for."""

    def __init__(self, net):
        self.distance = {"alex": 0.1, "vgg": 0.2}[net]

    def __call__(self, image, truth, *, rescale=True):
        return self.distance if rescale else self.distance / 2


def test_both_ranges_of_vgg_are_measured(monkeypatch):
    monkeypatch.setattr(module, "weights_status", lambda net: "")
    monkeypatch.setattr(module, "Lpips", FixedDistance)
    large = [view(width=32, height=32)] * 2
    scores = evaluate(constant(0.5, 0.5), large, WHITE, lpips_nets=("alex", "vgg"))
    assert (scores.lpips_alex, scores.lpips_vgg, scores.lpips_vgg_01) == (0.1, 0.2, 0.1)
    assert scores.lpips_note == ""
    assert scores.images[1].lpips_vgg_01 == 0.1


def test_views_too_small_for_a_net_leave_lpips_open(monkeypatch):
    monkeypatch.setattr(module, "weights_status", lambda net: "")
    monkeypatch.setattr(module, "Lpips", FixedDistance)
    scores = evaluate(constant(0.5), [view()], WHITE, lpips_nets=("alex", "vgg"))
    assert scores.lpips_alex is None
    assert scores.lpips_vgg == 0.2
    assert "31 pixels a side, these have 20" in scores.lpips_note


def test_no_views_are_refused():
    with pytest.raises(SceneError, match="no test views"):
        evaluate(constant(), [], WHITE)


def test_the_scores_are_fields_of_a_report():
    scores = evaluate(constant(0.5), [view()], WHITE)
    report = Report(**(vars(sample_report()) | vars(scores)))
    assert report.psnr == scores.psnr
    assert from_json(Report, to_json(report), "here.json") == report
