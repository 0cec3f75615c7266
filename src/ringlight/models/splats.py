"""A splat model: a table of Gaussians, a colour model that says what each emits, a shader, and a rasterizer."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color.contract import ColorModel, Harmonics
from ringlight.core.camera import Camera
from ringlight.core.computed_once import computed_once
from ringlight.core.directions import normalize, shortest_axes
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS
from ringlight.core.light_features import LightFeatures
from ringlight.core.raw_bytes import raw_bytes
from ringlight.core.rendering import Channels, Emission, Rendering
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.errors import RecipeError
from ringlight.models.contract import Count
from ringlight.models.outline import is_outline
from ringlight.models.way_back import ALPHA, WayBack, named_parts, ordered, shaded_in_tiles, with_factors
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from ringlight.shade.contract import Shader

# Alpha below which a pixel shows no surface: blended depth and normals are divided by at least this.
FAINTEST_SURFACE = 1e-4

NOUN = "Gaussians"
"""What a table's rows are called in reports."""


def move(model: nn.Module, device: torch.device) -> None:
    """All parameters, and what can be made anew; buffers of model files are switches and boxes, which Python reads."""
    if is_outline(model):
        return
    saved = model.state_dict().keys()
    kept = {name: buffer for name, buffer in model.named_buffers() if name in saved}
    model.to(device)
    for name, buffer in kept.items():
        owner, _, attribute = name.rpartition(".")
        setattr(model.get_submodule(owner), attribute, buffer)


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
        """Raises RecipeError where the shader needs a channel that the colour model does not emit."""
        super().__init__()
        self.columns = nn.ParameterDict({name: nn.Parameter(tensor) for name, tensor in gaussians.columns().items()})
        self.color, self.shader = color, shader
        self.rasterize, self.options = rasterize, options
        _refuse_mismatch(color, shader)
        if self.device.type != "cpu":
            move(self, self.device)

    @computed_once
    def _shared(self) -> list[nn.Parameter]:
        """All but the columns, which density control replaces; to find them at each step would take torch a while."""
        return [parameter for name, parameter in self.named_parameters() if not name.startswith(COLUMNS)]

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

    def predict(self, batch: ImageBatch, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        """What a training step asks: the batch's photograph, or crop, over its background, without the Gaussians that
        the step leaves out."""
        factors = None if batch.left_out is None else batch.left_out.factors(len(self), self.device)
        return self._rendered(batch.camera, batch.background, want, buffers, not buffers, factors)[0]

    def render(
        self, camera: Camera, background: Float[Tensor, "3"], want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        """One image over ``background``, which applies to "rgb" only.

        ``buffers`` are those that the caller looks at besides what the shader needs; see :meth:`refuse_unblended`.
        """
        return self._rendered(camera, background, want, buffers)[0]

    def by_opacity(
        self, camera: Camera, background: Float[Tensor, "3"], grad_color: Float[Tensor, "H W 3"]
    ) -> Float[Tensor, "N"]:
        """Of one picture: :meth:`WayBack.to_opacities`."""
        _, back = self._rendered(camera, background, Want.GRADIENTS, ())
        assert back is not None
        return back.to_opacities(grad_color, self.columns["opacity_logits"].detach())

    def _rendered(
        self,
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        buffers: Sequence[str],
        keeps_tiles: bool = False,
        factors: Float[Tensor, "N"] | None = None,
    ) -> tuple[Rendering, WayBack | None]:
        """And its way back, if wanted. With ``keeps_tiles`` what was blended may stay as it lay in the cache: the
        rendering has no buffers then. ``factors`` are constants by which opacities are multiplied."""
        needs = self.shader.needs
        names = (*needs, *(name for name in buffers if name not in needs and name != ALPHA))
        gaussians, widths = self.gaussians, [self.color.emits[name] for name in names]
        emission = ordered(self.color.emit(gaussians, camera, names, want), names)
        if factors is not None:
            emission = with_factors(emission, factors)
        behind = torch.cat(
            [background if name == "rgb" else background.new_zeros(self.color.emits[name]) for name in names]
        )
        # A shader of tiles takes what it needs and no more, and of a mere picture nothing else is kept.
        in_tiles = len(names) == len(needs) and not (buffers and want is Want.PICTURE)
        tiles = self.shader.tiles(camera, background, want) if in_tiles else None
        if tiles is not None and not keeps_tiles:
            tiles = replace(tiles, backward=None)
        raster = self.rasterize.draw(gaussians, emission, camera, behind, self.options, want, tiles)
        if raster.tiles is None:
            read = sum(needs.values())
            shaded = self.shader.shade(raster.image[..., :read], raster.alpha, camera, background, want, raster.shaded)
        else:
            shaded = shaded_in_tiles(raster, tiles)
        blended = {} if raster.image.shape[-1] == 0 else named_parts(raster, names, widths)
        if want is not Want.GRADIENTS:
            return Rendering(shaded.color, raster.alpha, blended, raster.footprint, camera=camera), None
        drawn = [*gaussians.columns().values(), *self._shared]
        back = WayBack(emission, raster, shaded, dict(zip(names, widths, strict=True)), drawn)
        return Rendering(shaded.color, raster.alpha, blended, raster.footprint, back, camera), back

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        """Raise RecipeError where ``who`` looks at a buffer that this model does not blend."""
        unknown = [name for name in buffers if name not in self.color.emits and name != ALPHA]
        if unknown:
            known = ", ".join([*self.color.emits, ALPHA])
            raise RecipeError(f"{who} looks at {unknown[0]!r}, which this model does not blend; it blends {known}")

    @torch.no_grad()
    def layers(self, camera: Camera) -> Channels:
        """What the picture is made of, over black, [H W c] by name.

        Always "alpha" 1, "depth" 1 (camera z of the surface, 0 where there is none), "normal" 3 (unit, world, towards
        the camera unless the colour model turns it; 0 where there is none) and "residual" 3 (what the colour model or
        else the shader adds to the base colour); the colour model adds its own ("base", ...), or better ones.
        """
        gaussians = self.gaussians
        factor = self.color.emit(gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
        channels = dict(self.color.layers(gaussians, camera))
        channels["depth"] = camera.depths(gaussians.means)[:, None]
        channels.setdefault("normal", shortest_axes(gaussians, camera.position.to(self.device)))
        widths = {name: values.shape[-1] for name, values in channels.items()}
        emission = Emission(widths, torch.cat(list(channels.values()), -1), factor)
        black = torch.zeros(sum(widths.values()))
        raster = self.rasterize.draw(gaussians, emission, camera, black, self.options)
        buffers = named_parts(raster, list(widths), list(widths.values()))
        surface = raster.alpha > FAINTEST_SURFACE
        buffers["depth"] = torch.where(surface, buffers["depth"] / raster.alpha.clamp_min(FAINTEST_SURFACE), 0)
        buffers["normal"] = normalize(buffers["normal"])
        if "residual" not in buffers:
            shown = self.render(camera, torch.zeros(3))
            buffers["residual"] = shown.color - buffers.get("base", shown.buffers["rgb"])
        return buffers

    @torch.no_grad()
    def features(self, camera: Camera, background: Float[Tensor, "3"]) -> LightFeatures | None:
        """Of the colour model, or else of the shader."""
        found = self.color.features(self.gaussians, camera)
        if found is not None or not self.shader.adds_light:
            return found
        shown = self.render(camera, background, Want.EXACT, tuple(self.shader.needs))
        return self.shader.features({**shown.buffers, ALPHA: shown.alpha}, camera, background)

    @torch.no_grad()
    def emitted(self, gaussians: Gaussians, camera: Camera) -> Float[Tensor, "n 3"]:
        """The colour that each of these rows would show alone."""
        emission = self.color.emit(gaussians, camera, tuple(self.shader.needs), Want.EXACT)
        return self.shader.emitted(emission.named(), gaussians.means, camera)

    row_prefixes: tuple[str, ...] = (COLUMNS,)
    resized_prefixes: tuple[str, ...] = ()

    @property
    def renderer(self) -> str:
        """What draws it, in words."""
        return f"{self.rasterize.name} rasterizer"

    @property
    def note(self) -> str | None:
        """What this back end draws otherwise than the others."""
        return self.rasterize.note

    def counted(self) -> Count:
        """All rows, masked ones too."""
        return Count(len(self), NOUN)

    def bytes_each(self) -> int:
        """Bytes of a row."""
        return sum(column[0].numel() * column.element_size() for column in self.columns.values())

    def rendering_tensors(self) -> dict[str, Tensor]:
        """What a model file holds: no unwanted rows, no columns that only training looks at."""
        return self._needed(self.color.wanted(self.gaussians))

    def rendering_size(self) -> tuple[Count, int]:
        """Of :meth:`rendering_tensors`, without its copies: rows, and bytes with floats at 32 bit."""
        count = int(self.color.wanted(self.gaussians).sum())
        return Count(count, NOUN), sum(raw_bytes(tensor) for tensor in self._needed(slice(count)).values())

    def _needed(self, keep: Bool[Tensor, "N"] | slice) -> dict[str, Tensor]:
        left_out = {COLUMNS + name for name in self.color.training_columns}
        tensors = {name: tensor for name, tensor in self.state_dict().items() if name not in left_out}
        return {name: t[keep] if name.startswith(COLUMNS) else t for name, t in tensors.items()}

    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """Take these tensors; the table becomes theirs, without the columns that they leave out."""
        columns = {name.removeprefix(COLUMNS): t for name, t in tensors.items() if name.startswith(COLUMNS)}
        for name in self.columns.keys() - columns.keys():
            self.columns.pop(name)
        self.load_columns(columns)
        self.load_state_dict(dict(tensors))

    def splats(self) -> "SplatModel":
        """Itself."""
        return self

    def solid(self) -> None:
        """None: it has no density, but a sum of Gaussians."""

    def harmonics(self, gaussians: Gaussians) -> Harmonics | None:
        """The colours of these rows as harmonics, if they are exactly that: no shader adds light."""
        return None if self.shader.adds_light else self.color.harmonics(gaussians)


def _refuse_mismatch(color: ColorModel, shader: Shader) -> None:
    """Raise RecipeError unless the colour model emits what the shader needs."""
    for name, width in shader.needs.items():
        if color.emits.get(name) != width:
            emitted = ", ".join(f"{other} {count}" for other, count in color.emits.items())
            raise RecipeError(
                f"the shader needs channel {name!r} of width {width}, and the colour model emits {emitted}; "
                "put together parts that agree"
            )
