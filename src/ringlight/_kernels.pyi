"""Signatures of the compiled module. Arrays are contiguous float32 CPU tensors; outputs are made by the caller."""

from collections.abc import Sequence

from torch import Tensor

def isa() -> str: ...
def set_threads(count: int) -> None: ...
def threads() -> int: ...
def set_memory(bytes: int) -> None: ...
def largest_buffer() -> int: ...
def keep_freed_memory() -> bool: ...
def multiply_adds(rounds: int, sums: Tensor) -> float: ...
def adam(
    values: Sequence[Tensor],
    gradients: Sequence[Tensor],
    means: Sequence[Tensor],
    squares: Sequence[Tensor],
    steps: Sequence[tuple[float, float, float, float, int]],
    radii: Tensor | None = None,
) -> int: ...
def accumulate_screen_gradient(
    gradient: Tensor, radii: Tensor, scale_x: float, scale_y: float, total: Tensor, views: Tensor
) -> None: ...
def photometric_workspace(height: int, width: int, slots: int) -> int: ...
def blur_target(image: Tensor, blur: Tensor, square_blur: Tensor, workspace: Tensor) -> None: ...
def photometric(
    image: Tensor,
    target: Tensor,
    target_blur: Tensor,
    target_square_blur: Tensor,
    gradient: Tensor,
    workspace: Tensor,
    pixel_weight: float,
    ssim_weight: float,
    squared: bool,
    value: Tensor | None = None,
) -> float: ...
def sh_slopes(rows: int) -> int: ...
def sh_colors(
    means: Tensor,
    constant: Tensor,
    rest: Tensor,
    camera: Camera,
    degree: int,
    colors: Tensor,
    slopes: Tensor | None = None,
) -> None: ...
def sh_gradient(
    upstream: Tensor, colors: Tensor, slopes: Tensor, by_means: Tensor, by_constant: Tensor, add: bool
) -> None: ...
def sh_rest_gradient(means: Tensor, camera: Camera, degree: int, by_constant: Tensor, by_rest: Tensor) -> None: ...
def sh_rest_adam(
    means: Tensor,
    camera: Camera,
    degree: int,
    by_constant: Tensor,
    rest: Tensor,
    mean: Tensor,
    square: Tensor,
    step: tuple[float, float, float, float, int],
) -> int: ...

class RingShape:
    def __init__(
        self,
        *,
        rank: int,
        features: int,
        render_hidden: int,
        modulation_hidden: int,
        nodes: int,
        view_nodes: int,
        latents: int,
        diagonal: bool,
    ) -> None: ...

def ring_forward(
    shape: RingShape,
    parameters: Sequence[Tensor],
    means: Tensor,
    base: Tensor,
    latents: Tensor,
    visible: Tensor,
    camera: Camera,
    box: Tensor,
    color: Tensor,
    residual: Tensor | None = None,
    modulation: Tensor | None = None,
) -> None: ...
def ring_backward(
    shape: RingShape,
    parameters: Sequence[Tensor],
    means: Tensor,
    base: Tensor,
    latents: Tensor,
    visible: Tensor,
    camera: Camera,
    box: Tensor,
    color: Tensor,
    color_gradient: Tensor,
    share: float,
    gradients: Sequence[Tensor],
    base_gradient: Tensor,
    latents_gradient: Tensor,
    workspace: Tensor,
) -> None: ...

class LazyColors: ...

class LazyRing(LazyColors):
    def __init__(
        self,
        shape: RingShape,
        parameters: Sequence[Tensor],
        means: Tensor,
        base: Tensor,
        latents: Tensor,
        camera: Camera,
        box: Tensor,
        colors: Tensor | None = None,
    ) -> None: ...

def ring_workspace(shape: RingShape, visible_count: int) -> int: ...

MAX_IMAGE_SIDE: int

class Camera:
    def __init__(
        self,
        *,
        world_to_camera: Tensor,
        position: Tensor,
        focal: tuple[float, float],
        center: tuple[float, float],
        width: int,
        height: int,
    ) -> None: ...

class RasterSettings:
    def __init__(self, eps2d: float, near: float, max_alpha: float, antialiased: bool, absgrad: bool) -> None: ...

class SplatTable:
    def __init__(
        self,
        means: Tensor,
        log_scales: Tensor,
        quats: Tensor,
        opacity_logits: Tensor,
        opacity_factor: Tensor | None,
        channels: Tensor,
        background: Tensor,
    ) -> None: ...

class SplatGradients:
    def __init__(
        self,
        means: Tensor,
        log_scales: Tensor,
        quats: Tensor,
        opacity_logits: Tensor,
        opacity_factor: Tensor | None,
        channels: Tensor,
        means2d: Tensor,
        absolute: Tensor | None,
    ) -> None: ...

class PictureShader: ...

class ReflectionShape:
    def __init__(
        self,
        *,
        hidden: int,
        layers: int,
        latents: int,
        shells: int,
        features: int,
        sides: Sequence[int],
        parallax: bool,
        direction: bool,
        depth_gradient: bool,
        axis_nodes: int,
    ) -> None: ...

class ReflectionView:
    def __init__(
        self,
        *,
        camera: Camera,
        box: Tensor,
        background: Tensor,
        faintest: float,
        shortest_normal: float,
        smallest_chord: float,
    ) -> None: ...

class ReflectionPicture(PictureShader):
    def __init__(
        self, shape: ReflectionShape, parameters: Sequence[Tensor], view: ReflectionView, exact: bool = False
    ) -> None: ...

class Workspace:
    def __init__(self) -> None: ...
    @property
    def stage_seconds(self) -> dict[str, float]: ...
    def forward(
        self,
        table: SplatTable,
        camera: Camera,
        settings: RasterSettings,
        image: Tensor,
        alpha: Tensor,
        means2d: Tensor,
        radii: Tensor,
        lazy: LazyColors | None = None,
        shader: PictureShader | None = None,
        blended: Tensor | None = None,
        early_stop: bool = False,
    ) -> None: ...
    def backward(
        self,
        table: SplatTable,
        image: Tensor,
        image_gradient: Tensor,
        alpha_gradient: Tensor | None,
        gradients: SplatGradients,
    ) -> None: ...
    def count_pairs(self) -> tuple[int, int]: ...

def perceptron_forward(parameters: Sequence[Tensor], rows: Tensor, results: Tensor) -> None: ...
def perceptron_backward(
    parameters: Sequence[Tensor], rows: Tensor, upstream: Tensor, gradients: Sequence[Tensor]
) -> None: ...

class MirrorView:
    def __init__(self, *, camera: Camera, flip_below: float, smallest_length: float) -> None: ...

def mirror_channels(view: MirrorView, columns: Sequence[Tensor], channels: Tensor) -> None: ...
def mirror_gradient(
    view: MirrorView, columns: Sequence[Tensor], upstream: Tensor, gradients: Sequence[Tensor]
) -> bool: ...
def reflection_forward(
    shape: ReflectionShape,
    parameters: Sequence[Tensor],
    view: ReflectionView,
    planes: Sequence[Tensor],
    color: Tensor,
) -> None: ...
def reflection_backward(
    shape: ReflectionShape,
    parameters: Sequence[Tensor],
    view: ReflectionView,
    planes: Sequence[Tensor],
    color_gradient: Tensor,
    share: float,
    gradients: Sequence[Tensor],
    plane_gradients: Sequence[Tensor],
) -> None: ...
def drawable_rows(
    means: Tensor,
    log_scales: Tensor,
    opacity_logits: Tensor,
    camera: Camera,
    rows: Tensor,
    *,
    reach_sigmas: float,
    reach_pixels: float,
    slope_margin: float,
    faintest_logit: float,
) -> int: ...
def straight_through(logits: Tensor, threshold: float, factor: Tensor) -> None: ...
def straight_through_gradient(logits: Tensor, upstream: Tensor, gradient: Tensor) -> None: ...
