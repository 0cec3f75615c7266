"""A splat model: a table of Gaussians, a colour model that says what each emits, a shader, and a rasterizer."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.color.contract import ColorModel, LateColors
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, shortest_axes
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import OPACITY_FACTOR, Channels, Raster, Rendering
from ringlight.models.direct import DirectModel
from ringlight.models.parts import joined, parted
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.shade.contract import Shader

# Alpha below which a pixel shows no surface: blended depth and normals are divided by at least this.
FAINTEST_SURFACE = 1e-4

COLUMNS_PREFIX = "columns."
"""Tensors below this name have one row a Gaussian."""


def move(model: nn.Module, device: torch.device) -> None:
    """All parameters, and what can be made anew; buffers of model files are switches and boxes, which Python reads."""
    if any(parameter.is_meta for parameter in model.parameters()):
        return  # an outline has no numbers to move
    saved = model.state_dict().keys()
    kept = {name: buffer for name, buffer in model.named_buffers() if name in saved}
    model.to(device)
    for name, buffer in kept.items():
        owner, _, attribute = name.rpartition(".")
        setattr(model.get_submodule(owner), attribute, buffer)


def backgrounds(channels: Channels, background: Float[Tensor, "3"]) -> Float[Tensor, "C"]:
    """What the channels side by side lie over: "rgb" over the background, the others over nothing."""
    black = background.new_zeros
    return torch.cat([background if name == "rgb" else black(c.shape[-1]) for name, c in channels.items()])


class SplatModel(nn.Module):
    """Anything splatted. One name per tensor everywhere: ``columns.means``, ``color.ring...``, ``shader...``."""

    def __init__(
        self,
        gaussians: Gaussians,
        color: ColorModel,
        shader: Shader,
        rasterize: Rasterizer,
        options: RasterOptions = RasterOptions(),
    ):
        super().__init__()
        self.columns = nn.ParameterDict({name: nn.Parameter(tensor) for name, tensor in gaussians.columns().items()})
        self.color, self.shader = color, shader
        self.rasterize, self.options = rasterize, options
        if self.device.type != "cpu":
            move(self, self.device)

    @property
    def device(self) -> torch.device:
        """Where the parameters are; the rasterizer says so."""
        return self.rasterize.device

    @property
    def gaussians(self) -> Gaussians:
        """The table, sharing memory with the parameters."""
        # Not items(): torch's dictionary of parameters looks each name up four times over.
        return Gaussians.from_columns({name: getattr(self.columns, name) for name in self.columns})

    def __len__(self) -> int:
        return self.columns["means"].shape[0]

    def load_columns(self, columns: Mapping[str, Tensor]) -> None:
        """Take these columns, of any number of rows, in place of the present ones."""
        for name, tensor in columns.items():
            self.columns[name] = nn.Parameter(tensor.detach().to(self.device, copy=True))

    def render(self, camera: Camera, background: Float[Tensor, "3"]) -> Rendering:
        """One image over ``background``."""
        gaussians = self.gaussians
        raster = self._drawn_late(gaussians, camera, background)
        if raster is not None:
            return Rendering(raster.image, raster.alpha, {"rgb": raster.image, "alpha": raster.alpha}, raster)
        channels = dict(self.color.channels(gaussians, camera))
        factor = channels.pop(OPACITY_FACTOR, None)
        rendering = self.blend(gaussians, channels, factor, camera, background)
        color = self.shader.shade(rendering.buffers, camera, background)
        return Rendering(color, rendering.alpha, rendering.buffers, rendering.raster)

    def _drawn_late(self, gaussians: Gaussians, camera: Camera, background: Float[Tensor, "3"]) -> Raster | None:
        """Where nobody wants gradients, only rows that can be seen are coloured; None if a part cannot do so."""
        late, draw = getattr(self.color, "late", None), getattr(self.rasterize, "draw_late", None)
        if torch.is_grad_enabled() or late is None or draw is None or not getattr(self.shader, "passes_through", False):
            return None
        colors: LateColors | None = late(gaussians, camera)
        if colors is None:
            return None
        drawn: Raster | None = draw(
            gaussians, colors.checked, colors.kernel, camera, background, self.options, colors.opacity_factor
        )
        return drawn

    @torch.no_grad()
    def picture(self, camera: Camera, background: Float[Tensor, "3"]) -> Rendering:
        """As :meth:`render`, for who wants colour and alpha alone: shaded while it is blended, where parts can."""
        shaded, tiles = (
            getattr(part, name, None) for part, name in ((self.rasterize, "shaded"), (self.shader, "tiles"))
        )
        shader = None if shaded is None or tiles is None else tiles(camera, background)
        if shaded is None or shader is None:
            return self.render(camera, background)
        gaussians = self.gaussians
        channels = dict(self.color.channels(gaussians, camera))
        factor = channels.pop(OPACITY_FACTOR, None)
        opacity_factor, options = None if factor is None else factor[:, 0], self.options
        values, behind = joined(list(channels.values())), backgrounds(channels, background)
        raster = shaded(gaussians, values, camera, behind, shader, options, opacity_factor)
        return Rendering(raster.image, raster.alpha, raster=raster)

    def direct(self) -> DirectModel | None:
        """Pictures and gradients without autograd, or None where a part of this model has no such form."""
        parts = (self.color, self.rasterize, self.shader)
        color, rasterize, shader = (getattr(part, "direct", lambda: None)() for part in parts)
        shades = not getattr(self.shader, "passes_through", False)
        if color is None or rasterize is None or (shader is None and shades):
            return None
        return DirectModel(self, color, rasterize, shader)

    @torch.no_grad()
    def layers(self, camera: Camera) -> Channels:
        """What the picture is made of, over black, [H W c] by name.

        Always "alpha" 1, "depth" 1 (camera z of the surface, 0 where there is none) and "normal" 3 (unit, world,
        towards the camera; 0 where there is none) and "residual" 3 (what the colour model or else the shader adds to
        the base colour); the colour model adds its own ("base", ...), or better ones.
        """
        gaussians = self.gaussians
        factor = self.color.channels(gaussians, camera).get(OPACITY_FACTOR)
        channels = dict(self.color.layers(gaussians, camera))
        channels["depth"] = camera.depths(gaussians.means)[:, None]
        channels.setdefault("normal", shortest_axes(gaussians, camera.position.to(self.device)))
        rendering = self.blend(gaussians, channels, factor, camera, torch.zeros(3))
        buffers = dict(rendering.buffers)
        surface = rendering.alpha > FAINTEST_SURFACE
        buffers["depth"] = torch.where(surface, buffers["depth"] / rendering.alpha.clamp_min(FAINTEST_SURFACE), 0)
        buffers["normal"] = normalize(buffers["normal"])
        if "residual" not in buffers:
            shown = self.render(camera, torch.zeros(3))
            buffers["residual"] = shown.color - shown.buffers["rgb"]
        return buffers

    @torch.no_grad()
    def emitted(self, gaussians: Gaussians, camera: Camera) -> Float[Tensor, "n 3"]:
        """The colour that each of these rows would show alone."""
        return self.shader.emitted(self.color.channels(gaussians, camera), gaussians.means, camera)

    def blend(
        self,
        gaussians: Gaussians,
        channels: Channels,
        factor: Float[Tensor, "N 1"] | None,
        camera: Camera,
        background: Float[Tensor, "3"],
    ) -> Rendering:
        """Blend all channels, and "alpha", in one pass; the background applies to "rgb" only."""
        opacity_factor, options = None if factor is None else factor[:, 0], self.options
        if list(channels) == ["rgb"]:
            raster = self.rasterize(gaussians, channels["rgb"], camera, background, options, opacity_factor)
            return Rendering(raster.image, raster.alpha, {"rgb": raster.image, "alpha": raster.alpha}, raster)
        widths = [values.shape[-1] for values in channels.values()]
        values, behind = joined(list(channels.values())), backgrounds(channels, background)
        raster = self.rasterize(gaussians, values, camera, behind, options, opacity_factor)
        buffers = dict(zip(channels, parted(raster.image, widths), strict=True)) | {"alpha": raster.alpha}
        return Rendering(buffers.get("rgb", raster.image[..., :3]), raster.alpha, buffers, raster)
