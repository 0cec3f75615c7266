"""The RingLight colour model: a base colour per Gaussian, and a residual from one shared light field."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from ringlight.color.contract import LateColors
from ringlight.color.drawable import drawable_rows
from ringlight.color.light_fields import light_field
from ringlight.color.render_module import LitColor, RenderModule
from ringlight.color.ring_kernel import (
    LitRows,
    RingParameters,
    Workspace,
    kernel_takes,
    late_light,
    light,
    light_layers,
    ring_parameters,
    shading_layers,
)
from ringlight.color.ringlight_direct import BASE, LATENTS, MASK, DirectRingLight
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.color.table_memory import TableMemory
from ringlight.color.visibility_mask import straight_through_mask
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.lot import by_lot
from ringlight.core.randomness import generator
from ringlight.core.rendering import OPACITY_FACTOR, Channels
from ringlight.core.scene import PointCloud
from ringlight.core.triton_kernels import runs_triton
from ringlight.fields.contract import LightField
from ringlight.fields.ring_tables import RingTables

# The logit of pure black or white would be infinite; a quarter of an 8-bit step away still rounds to either.
DARKEST = 0.25 / 255
# sigmoid(1) = 0.73: visible, and where the sigmoid still has a gradient (Compact 3DGS).
FIRST_MASK_LOGIT = 1.0
# Standard deviation of new latents: not zero, so that they differ at once and their weights get a gradient, and small
# beside features and colours, so that noise does not drown these.
LATENT_SPREAD = 0.1


class RingLight(nn.Module):
    """c(v) = clamp(c_b + c_r(v), 0, 1), with c_r from the neural tensor ring (RingLight-GS, section 3.2).

    Columns: ``base`` [N 3], the base colour's logit, c_b = sigmoid(base), or none, and c_b is grey; ``mask_logits``
    [N], if masked; ``latents`` [N L], if there are any, see the settings.
    Buffers: ``box`` [low, high], what the ring's [-1, 1]^3 covers, world units; ``lit``, False during the warm-up,
    when Gaussians show their base colour and the field gets no gradient. Positions and directions are detached:
    ten bands would otherwise drown the rasterizer's gradient of the positions.
    """

    box: Tensor
    lit: Tensor
    training_columns: tuple[str, ...] = (MASK,)

    def __init__(self, settings: RingLightSettings, box: Float[Tensor, "2 3"], seed: int = 0):
        super().__init__()
        of_networks = generator(seed, 0, "networks")
        self.settings, self._seed = settings, seed
        self.add_module(settings.field, light_field(settings, of_networks))  # type: ignore[arg-type]
        self.shading = RenderModule(settings, of_networks)
        self.register_buffer("box", box.clone().float())
        self.register_buffer("lit", torch.tensor(True))
        self._memory = TableMemory()
        # Kept, since to find them takes torch as long as a hundredth of a picture; modules keep their parameters.
        self._of_field = list(self.get_submodule(settings.field).parameters())
        self._of_shading = shading_layers(self.shading)
        self.workspace = Workspace()

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Base colours equal to the points' (black and white to a quarter of an 8-bit step), masks open.

        Latents are drawn anew by the model's seed, the same at every call.
        """
        columns = {BASE: points.colors.clamp(DARKEST, 1 - DARKEST).logit()} if self.settings.base_color else {}
        if self.settings.mask:
            columns[MASK] = points.colors.new_full((len(points.colors),), FIRST_MASK_LOGIT)
        if self.settings.latents:
            noise = torch.randn(len(points.colors), self.settings.latents, generator=generator(self._seed, 0, LATENTS))
            columns[LATENTS] = LATENT_SPREAD * noise.to(points.colors)
        return columns

    def channels(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "rgb" [N 3] in [0, 1], and "opacity_factor" [N 1], zero or one, if masked.

        Rows that the camera cannot see get their base colour.
        """
        channels: Channels = {"rgb": self._emitted(gaussians, camera) if self.lit else self._base(gaussians).sigmoid()}
        if MASK in gaussians.appearance:
            channels[OPACITY_FACTOR] = straight_through_mask(gaussians.appearance[MASK], self.settings.mask_threshold)
        return channels

    @torch.no_grad()
    def late(self, gaussians: Gaussians, camera: Camera) -> LateColors | None:
        """The same as ``channels``, when the blend asks; None unlit, and where there is no kernel."""
        parameters = self._kernel_parameters(gaussians) if self.lit else None
        if parameters is None:
            return None
        factor = None
        if MASK in gaussians.appearance:
            factor = straight_through_mask(gaussians.appearance[MASK], self.settings.mask_threshold)[:, 0]
        base = self._base(gaussians)
        kernel = late_light(gaussians.means, camera.native, self.box, base, self._latents(gaussians), parameters)
        return LateColors(base, kernel, factor)

    def direct(self) -> DirectRingLight | None:
        """The same without autograd, by the kernels; None where they do not apply."""
        with torch.no_grad():
            tables = None if self.settings.evaluation == "exact" else self.field.tables()
        if tables is None or not self.settings.base_color or not kernel_takes(tables, self._of_shading, self.box):
            return None
        return DirectRingLight(self)

    def field_parameters(self) -> list[nn.Parameter]:
        """Those that the features are made of."""
        return self._of_field

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """Parts of the colour, without gradient: "base" [N 3], "residual" [N 3] signed, "modulation" [N 1].

        Residual and modulation are zero where the camera cannot see, and everywhere during the warm-up.
        """
        base = self._base(gaussians)
        nothing = LitColor(base.sigmoid(), torch.zeros_like(base), torch.zeros_like(base[:, :1]))
        lit = self._layers(gaussians, camera) if self.lit else nothing
        return {"base": nothing.color, "residual": lit.residual, "modulation": lit.modulation}

    @torch.no_grad()
    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Rows that the mask leaves visible; a table without masks, as model files hold it, is wanted whole."""
        if MASK not in gaussians.appearance:
            return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)
        return gaussians.appearance[MASK].sigmoid() > self.settings.mask_threshold

    def unit_points(self, means: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """World positions in the ring's coordinates: the box to [-1, 1]^3, clamped, detached."""
        low, high = self.box.to(means)
        return ((means.detach() - low) * (2 / (high - low)) - 1).clamp(-1, 1)

    @property
    def field(self) -> LightField:
        """What makes the features."""
        chosen: LightField = getattr(self, self.settings.field)
        return chosen

    def tables(self) -> RingTables | None:
        """The field's tables: made anew where gradients are recorded, else kept until a parameter's value changes.

        None for a field that is no ring.
        """
        if torch.is_grad_enabled():
            return self.field.tables()
        return self._memory.recall(self.field_parameters(), self.field.tables)

    def _emitted(self, gaussians: Gaussians, camera: Camera) -> Float[Tensor, "N 3"]:
        parameters = self._kernel_parameters(gaussians)
        if parameters is None:
            return self.twin(gaussians, camera).color
        base, latents = self._base(gaussians), self._latents(gaussians)
        rows, share = self.lit_rows(gaussians, camera), self.settings.gradient_share
        return light(rows, base, latents, parameters, share, self.workspace)

    def _layers(self, gaussians: Gaussians, camera: Camera) -> LitColor:
        parameters = self._kernel_parameters(gaussians)
        if parameters is None:
            return self.twin(gaussians, camera)
        base, latents = self._base(gaussians), self._latents(gaussians)
        return light_layers(self.lit_rows(gaussians, camera), base, latents, parameters)

    def _base(self, gaussians: Gaussians) -> Float[Tensor, "N 3"]:
        """The table's; logits of grey where the settings want no base colour."""
        if not self.settings.base_color:
            return torch.zeros_like(gaussians.means)
        return gaussians.appearance[BASE]

    def _latents(self, gaussians: Gaussians) -> Float[Tensor, "N L"]:
        """The table's; of width zero where the settings want none."""
        if not self.settings.latents:
            return gaussians.means.new_empty((len(gaussians), 0))
        return gaussians.appearance[LATENTS]

    def _kernel_parameters(self, gaussians: Gaussians) -> RingParameters | None:
        """What the kernel needs, or None where it does not apply: no ring, exact heads, another type, device or
        size."""
        if self.settings.evaluation == "exact":
            return None
        tables = self.tables()
        if tables is None or not kernel_takes(tables, self._of_shading, gaussians.means):
            return None
        return ring_parameters(tables, self.shading, self._of_shading)

    def lit_rows(self, gaussians: Gaussians, camera: Camera) -> LitRows:
        """Which rows the light field reaches from there."""
        means, visible = gaussians.means.detach().contiguous(), drawable_rows(gaussians, camera)
        return LitRows(means, visible, camera.native, self.box)

    def twin(self, gaussians: Gaussians, camera: Camera, gradient_share: float = 1.0) -> LitColor:
        """What the kernel computes, in torch and in any precision: slow, and the judge of the kernel.

        On a GPU field and networks are Triton's. Residual and modulation are zero where the camera cannot see. Here
        ``gradient_share`` saves no time.
        """
        visible = drawable_rows(gaussians, camera).long()
        means, base = gaussians.means.detach()[visible], self._base(gaussians).sigmoid()
        directions = view_directions(means, camera.position.to(means))
        points, latents = self.unit_points(means), self._latents(gaussians)[visible]
        tables = None if self.settings.evaluation == "exact" else self.tables()

        def lit_rows() -> LitColor:
            if self.settings.evaluation == "exact":
                features = self.field.exact(points, directions)
            else:
                features = self.field.tabulated(points, directions, tables)
            return self.shading(features, directions, base[visible], latents)

        # On a GPU nothing of a row is kept for the backward pass: kernels make it again sooner than memory is read.
        again = runs_triton(means) and torch.is_grad_enabled()
        lit = checkpoint(lit_rows, use_reentrant=False) if again else lit_rows()
        color = (base[visible] + by_lot(lit.residual, gradient_share)).clamp(0, 1)
        return LitColor(
            base.index_put((visible,), color),
            torch.zeros_like(base).index_put((visible,), lit.residual),
            torch.zeros_like(base[:, :1]).index_put((visible,), lit.modulation),
        )
