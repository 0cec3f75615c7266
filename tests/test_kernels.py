"""The compiled module by itself: what its bindings refuse, threads that cannot be had, forks."""

import os
import subprocess
import sys

import pytest
import torch

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.memory import machine_memory
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu import CpuRasterizer


def perceptron(width: int = 4) -> tuple[list[torch.Tensor], torch.Tensor]:
    """Six parameters of one head, and three rows."""
    return [torch.ones(1, width, width), torch.ones(1, 1, width)] * 3, torch.ones(1, 3, width)


@pytest.mark.parametrize("spoil", [torch.Tensor.double, lambda tensor: tensor.mT])
def test_arrays_in_lists_are_never_copied(spoil):
    """A copy would take the gradients with it."""
    parameters, rows = perceptron()
    spoiled = [spoil(torch.empty(1, 4, 4)), *parameters[1:]]
    with pytest.raises(TypeError):
        _kernels.perceptron_forward(spoiled, rows, torch.empty(1, 3, 4))
    with pytest.raises(TypeError):
        _kernels.perceptron_backward(parameters, rows, torch.ones(1, 3, 4), spoiled)


def test_results_of_another_size_are_refused():
    parameters, rows = perceptron()
    with pytest.raises(ValueError, match="H K outputs"):
        _kernels.perceptron_forward(parameters, rows, torch.empty(13))


def test_the_first_update_is_number_one():
    with pytest.raises(ValueError, match="from 1"):
        _kernels.adam(*([row] for row in torch.ones(4, 8)), [(0.1, 0.9, 0.999, 1e-8, 0)])


def test_results_must_not_lie_on_the_images():
    image = torch.zeros(3, 8, 8)
    workspace = torch.empty(_kernels.photometric_workspace(8, 8, 1))
    with pytest.raises(ValueError, match="share memory"):
        _kernels.photometric(image, image, image, image, image, workspace, 0.8, 0.2, False)
    with pytest.raises(ValueError, match="share memory"):
        _kernels.blur_target(image, image, torch.empty_like(image), workspace)


@pytest.mark.parametrize("sizes", [(0, 8, 1), (8, -1, 1), (8, 8, 0)])
def test_a_workspace_for_nothing_is_refused(sizes):
    with pytest.raises(ValueError, match="positive"):
        _kernels.photometric_workspace(*sizes)


def square_camera(size: int) -> _kernels.Camera:
    return Camera(torch.eye(4), (float(size), float(size)), (size / 2, size / 2), size, size).native


def test_a_forward_pass_that_failed_has_no_backward_pass():
    count = 70_000  # Gaussians that each cover 65,536 tiles
    means = torch.tensor([0.0, 0, 1]).repeat(count, 1)
    columns = [means, torch.full((count, 3), 3.0), torch.ones(count, 4), torch.zeros(count)]
    table = _kernels.SplatTable(*columns, None, torch.ones(count, 1), torch.zeros(1))
    gradients = _kernels.SplatGradients(*columns, None, torch.ones(count, 1), torch.zeros(count, 2), None)
    camera = square_camera(8192)
    settings = _kernels.RasterSettings(**vars(RasterOptions()))
    image, alpha, footprint = torch.empty(1, 8192, 8192), torch.empty(8192, 8192), torch.empty(count, 2)
    workspace = _kernels.Workspace()
    with pytest.raises(MemoryError):
        workspace.forward(table, camera, settings, image, alpha, footprint, footprint.clone())
    with pytest.raises(ValueError, match="last forward pass"):
        workspace.backward(table, image, image, None, gradients)


def test_no_buffer_takes_more_than_half_of_the_memory_that_is_stated():
    size = 512  # pixels, of which a view keeps four bytes each in one buffer
    means = torch.tensor([[0.0, 0, 1]])
    columns = [means, torch.full((1, 3), -9.0), torch.ones(1, 4), torch.zeros(1)]
    table = _kernels.SplatTable(*columns, None, torch.ones(1, 1), torch.zeros(1))
    camera = square_camera(size)
    settings = _kernels.RasterSettings(**vars(RasterOptions()))
    image, alpha, footprint = torch.empty(1, size, size), torch.empty(size, size), torch.empty(1, 2)

    def draw() -> None:
        _kernels.Workspace().forward(table, camera, settings, image, alpha, footprint, footprint.clone())

    try:
        _kernels.set_memory(2 * 4 * size * size)
        assert _kernels.largest_buffer() == 4 * size * size
        draw()  # without the head room that it would otherwise take
        _kernels.set_memory(2 * 4 * size * size - 2)
        with pytest.raises(MemoryError):
            draw()
    finally:
        _kernels.set_memory(0)
    assert _kernels.largest_buffer() == os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    CpuRasterizer()
    assert _kernels.largest_buffer() == machine_memory() // 2


def test_every_number_of_a_camera_is_looked_at_alone():
    """Two large focal lengths have a sum that is not finite."""
    columns = [torch.empty(0, 3), torch.empty(0, 3), torch.empty(0, 4), torch.empty(0)]
    table = _kernels.SplatTable(*columns, None, torch.empty(0, 1), torch.zeros(1))
    settings = _kernels.RasterSettings(**vars(RasterOptions()))
    image, alpha, footprint = torch.empty(1, 8, 8), torch.empty(8, 8), torch.empty(0, 2)

    def draw(focal_x: float, focal_y: float, center_x: float, center_y: float) -> None:
        camera = _kernels.Camera(
            world_to_camera=torch.eye(4), position=torch.zeros(3), focal=(focal_x, focal_y),
            center=(center_x, center_y), width=8, height=8,
        )  # fmt: skip
        _kernels.Workspace().forward(table, camera, settings, image, alpha, footprint, footprint.clone())

    draw(3e38, 3e38, 4.0, 4.0)
    for bad in (float("nan"), float("inf")):
        numbers = [8.0, 8.0, 4.0, 4.0]
        for place in range(4):
            with pytest.raises(ValueError, match="camera must be finite"):
                draw(*numbers[:place], bad, *numbers[place + 1 :])


@pytest.mark.parametrize(("name", "size"), [("rank", 0), ("rank", 33), ("features", 65), ("nodes", 1), ("latents", 17)])
def test_sizes_that_the_light_field_does_not_take_are_refused(name: str, size: int):
    sizes = {"rank": 8, "features": 12, "render_hidden": 32, "modulation_hidden": 0, "nodes": 8, "view_nodes": 4}
    with pytest.raises(ValueError, match=f"{name} out of range"):
        _kernels.RingShape(**{**sizes, "latents": 0, "diagonal": False, "factor": False, "clamped": True, name: size})


@pytest.mark.parametrize(("name", "size"), [("hidden", 129), ("layers", 1), ("sides", []), ("sides", [1025])])
def test_sizes_that_the_reflection_shader_does_not_take_are_refused(name: str, size: int | list[int]):
    sizes = {"hidden": 32, "layers": 3, "latents": 0, "shells": 1, "features": 4, "sides": [8], "axis_nodes": 0}
    kind = {"parallax": False, "direction": False, "depth_gradient": False}
    with pytest.raises(ValueError, match="out of range"):
        _kernels.ReflectionShape(**{**sizes, **kind, name: size})


def freed(tensor: torch.Tensor) -> torch.Tensor:
    """A shape without memory behind it."""
    tensor.untyped_storage().resize_(0)
    return tensor


def images(change=lambda tensor: tensor) -> list[torch.Tensor]:
    """Image, target, two blurs and the gradient of a photometric loss, one of them changed."""
    return [change(torch.zeros(3, 8, 8)), *(torch.zeros(3, 8, 8) for _ in range(4))]


@pytest.mark.parametrize(
    "spoil",
    [
        torch.Tensor.double,
        torch.Tensor.int,
        lambda tensor: tensor.transpose(1, 2),
        lambda tensor: tensor[..., ::2],
        lambda tensor: tensor[0],
        lambda tensor: tensor[None],
        lambda tensor: tensor[None, None, None],
        lambda tensor: tensor.to("meta"),
        freed,
        lambda tensor: torch._efficientzerotensor(tensor.shape),
        torch._neg_view,
        lambda tensor: tensor.numpy().astype("float64"),
        lambda tensor: tensor.numpy()[:, ::2],
        lambda tensor: tensor.tolist(),
        lambda tensor: None,
    ],
)
def test_what_is_no_array_of_that_kind_is_refused(spoil):
    workspace = torch.empty(_kernels.photometric_workspace(8, 8, 1))
    with pytest.raises(TypeError):
        _kernels.photometric(*images(spoil), workspace, 0.8, 0.2, False)


def test_tensors_parameters_views_and_numpy_arrays_are_the_same_array():
    workspace = torch.empty(_kernels.photometric_workspace(8, 8, 1))
    draw = torch.Generator().manual_seed(0)
    many = torch.rand(2, 3, 8, 8, generator=draw)
    values = set()
    for image in (many[1].clone(), torch.nn.Parameter(many[1].clone()), many[1], many[1].numpy()):
        values.add(_kernels.photometric(*images(lambda _, image=image: image), workspace, 0.8, 0.2, False))
    assert len(values) == 1


class OldTensor:
    """A tensor as libraries without an exchange table show it: __dlpack__ refuses what needs a gradient."""

    def __init__(self, tensor: torch.Tensor, needs_gradient: bool = True):
        self.tensor, self.needs_gradient = tensor, needs_gradient

    def detach(self) -> "OldTensor":
        return OldTensor(self.tensor, needs_gradient=False)

    def __dlpack__(self, **wishes: object) -> object:
        if self.needs_gradient:
            raise BufferError("needs a gradient")
        return self.tensor.__dlpack__(**wishes)

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.tensor.__dlpack_device__()


def test_older_tensors_are_written_in_place_too():
    value, rows = torch.ones(8), torch.ones(3, 8)
    _kernels.adam([OldTensor(value)], [OldTensor(rows[0])], [rows[1]], [rows[2]], [(0.5, 0.9, 0.999, 1e-8, 1)])
    assert (value < 1).all()


def test_sizes_of_one_need_no_stride():
    """torch gives an axis of one element any stride."""
    workspace = torch.empty(_kernels.photometric_workspace(8, 1, 1))
    odd = torch.zeros(3, 8, 1).as_strided((3, 8, 1), (8, 1, 5))
    rest = [torch.zeros(3, 8, 1) for _ in range(4)]
    assert _kernels.photometric(odd, *rest, workspace, 1.0, 0.0, False) == 0


STEP = """
import numpy, os, resource, sys
from ringlight import _kernels
def step(threads):
    _kernels.set_threads(threads)
    value, gradient, mean, square = numpy.random.default_rng(0).random((4, 200_000), dtype=numpy.float32)
    _kernels.adam([value], [gradient], [mean], [square], [(0.1, 0.9, 0.999, 1e-8, 1)])
    return value
alone = step(1)
"""


def run_alone(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", STEP + code], check=False, capture_output=True, text=True, timeout=60)


def test_threads_that_the_system_does_not_give_are_done_without():
    """With room for a few stacks only, a thousand threads are asked for."""
    code = """
pages = int(open("/proc/self/statm").read().split()[0])
room = pages * resource.getpagesize() + (256 << 20)
resource.setrlimit(resource.RLIMIT_AS, (room, room))
sys.exit(_kernels.threads() > 1024 or not (step(2**31 - 1) == alone).all())
"""
    result = run_alone(code)
    assert result.returncode == 0, result.stderr


def test_a_forked_process_has_threads_of_its_own():
    code = """
step(2)
child = os.fork()
if child == 0:
    os._exit(0 if (step(2) == alone).all() else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    result = run_alone(code)
    assert result.returncode == 0, result.stderr


def test_freed_memory_is_kept_or_the_library_says_that_it_cannot():
    """Kept: an array as large as one before it needs no pages from the system."""
    code = """
def pages_of_an_array():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    numpy.ones(16 << 20, dtype=numpy.float32)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
kept = _kernels.keep_freed_memory()
assert (step(2) == alone).all()
first, *later = [pages_of_an_array() for _ in range(5)]
assert not kept or max(later) < first / 10, (first, later)
"""
    done = run_alone(code)
    assert done.returncode == 0, done.stderr
