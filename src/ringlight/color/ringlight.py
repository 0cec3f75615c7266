"""The RingLight colour model: a base colour per Gaussian, and a residual from one shared light field."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from ringlight.color.by_torch import OPACITY_FACTOR, emitted_by_torch
from ringlight.color.drawable import drawable_rows
from ringlight.color.light_fields import FIELDS
from ringlight.color.render_module import LitColor, RenderModule
from ringlight.color.ring_emission import BASE, LATENTS, MASK, base_emission, gained_emission, ring_emission
from ringlight.color.ring_kernel import (
    LitRows,
    Workspace,
    kernel_takes,
    light_layers,
    ring_parameters,
    shading_layers,
)
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.color.table_memory import TableMemory
from ringlight.color.visibility_mask import straight_through_reference
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR
from ringlight.core.importance_sampling import importance_sampled
from ringlight.core.light_features import LightFeatures, evenly, flat_tanh
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import DARKEST, PointCloud
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want
from ringlight.fields.contract import LightField
from ringlight.fields.ring_tables import RingTables, tabulated_features

MEANS = "means"
# sigmoid(1) = 0.73: visible, and where the sigmoid still has a gradient (Compact 3DGS).
FIRST_MASK_LOGIT = 1.0
# Standard deviation of new latents: not zero, so that they differ at once and their weights get a gradient, and small
# beside features and colours, so that noise does not drown these.
LATENT_DEVIATION = 0.1


class RingLight(nn.Module):
    """c(v) = clamp(c_b + c_r(v), 0, 1), with c_r from the neural tensor ring (RingLight-GS, section 3.2); the clamp is
    a setting.

    Columns: ``base`` [N 3], the base colour's logit, c_b = sigmoid(base), or none, and c_b is grey; ``mask_logits``
    [N], if masked; ``latents`` [N L], if there are any, see the settings.
    Buffers: ``box`` [low, high], what the ring's [-1, 1]^3 covers, world units; ``lit``, False during the warm-up,
    when Gaussians show their base colour and the field gets no gradient. Positions and directions are detached unless
    the settings say otherwise: ten bands would drown the rasterizer's gradient of the positions.
    """

    box: Tensor
    lit: Tensor
    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = (MASK,)
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def __init__(self, settings: RingLightSettings, box: Float[Tensor, "2 3"], seed: int = 0):
        super().__init__()
        of_networks = generator(seed, 0, "networks")
        self.settings, self._seed = settings, seed
        self.add_module(settings.field, FIELDS[settings.field](settings, of_networks))  # type: ignore[arg-type]
        self.shading = RenderModule(settings, of_networks)
        self.register_buffer("box", box.clone().float())
        self.register_buffer("lit", torch.tensor(True))
        self._memory = TableMemory()
        # Kept, since to find them takes torch as long as a hundredth of a picture; modules keep their parameters.
        self._of_field = list(self.get_submodule(settings.field).parameters())
        self.layers_of_shading = shading_layers(self.shading)
        names = {id(parameter): name for name, parameter in self.named_parameters()}
        self.names_of_shading = [names[id(layer)] for layer in self.layers_of_shading]
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
            columns[LATENTS] = LATENT_DEVIATION * noise.to(points.colors)
        return columns

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], in [0, 1] if the settings clamp, and an opacity factor, zero or one, if masked.

        Rows that the camera cannot see get their base colour.
        """
        if not self.lit:
            return base_emission(self, gaussians, want)
        tables = self._native_tables(gaussians, want)
        if tables is None or (self.shading.gain is not None and want is Want.GRADIENTS):
            return self._emission_by_torch(gaussians, camera, want)
        if self.shading.gain is not None:
            return gained_emission(self, gaussians, self._layers(gaussians, camera).color)
        return ring_emission(self, gaussians, camera, tables, want)

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """Parts of the colour, without gradient: "base" [N 3], "residual" [N 3] signed, "modulation" [N 1].

        Residual and modulation are zero where the camera cannot see, and everywhere during the warm-up.
        """
        base = self.base(gaussians)
        nothing = LitColor(base.sigmoid(), torch.zeros_like(base), torch.zeros_like(base[:, :1]))
        lit = self._layers(gaussians, camera) if self.lit else nothing
        return {"base": nothing.color, "residual": lit.residual, "modulation": lit.modulation}

    @torch.no_grad()
    def features(self, gaussians: Gaussians, camera: Camera) -> LightFeatures | None:
        """The field's, behind their tanh, at Gaussians in the picture; None during the warm-up."""
        if not self.lit:
            return None
        visible = drawable_rows(gaussians, camera).long()
        rows = visible[evenly(len(visible)).to(visible.device)]
        means = gaussians.means.detach()[rows]
        directions = view_directions(means, camera.position.to(means))
        tables = None if self.settings.evaluation == "exact" else self.tables(Want.EXACT)
        features = self._features(self.unit_points(means), directions, tables)
        base, latents = self.base(gaussians)[rows].sigmoid(), self.latents(gaussians)[rows]
        inputs, _ = self.shading.inputs(features, directions, base, latents)
        activated = torch.tanh(features)
        return LightFeatures(activated, flat_tanh(activated), self.shading.render.hidden(inputs))

    @torch.no_grad()
    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Rows that the mask leaves visible; a table without masks, as model files hold it, is wanted whole."""
        if MASK not in gaussians.appearance:
            return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)
        return gaussians.appearance[MASK].sigmoid() > self.settings.mask_threshold

    def harmonics(self, gaussians: Gaussians) -> None:
        """None: the colour is a network's."""

    def unit_points(self, means: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """World positions in the ring's coordinates: the box to [-1, 1]^3, clamped, detached as the settings say."""
        low, high = self.box.to(means)
        return ((self._seen(means) - low) * (2 / (high - low)) - 1).clamp(-1, 1)

    def _seen(self, means: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        return means if self.settings.position_gradients else means.detach()

    @property
    def field(self) -> LightField:
        """What makes the features."""
        chosen: LightField = getattr(self, self.settings.field)
        return chosen

    def tables(self, want: Want) -> RingTables | None:
        """The field's tables: made anew with a way back, else kept until a parameter's value changes.

        None for a field that is no ring.
        """
        if want is Want.GRADIENTS:
            return self.field.tables(want)
        return self._memory.recall(self._of_field, lambda: self.field.tables(want))

    def base(self, gaussians: Gaussians) -> Float[Tensor, "N 3"]:
        """The table's; logits of grey where the settings want no base colour."""
        if not self.settings.base_color:
            return torch.zeros_like(gaussians.means)
        return gaussians.appearance[BASE]

    def latents(self, gaussians: Gaussians) -> Float[Tensor, "N L"]:
        """The table's; of width zero where the settings want none."""
        if not self.settings.latents:
            return gaussians.means.new_empty((len(gaussians), 0))
        return gaussians.appearance[LATENTS]

    def lit_rows(self, gaussians: Gaussians, camera: Camera) -> LitRows:
        """Which rows the light field reaches from there."""
        means, visible = gaussians.means.detach().contiguous(), drawable_rows(gaussians, camera)
        return LitRows(means, visible, camera.native, self.box)

    @torch.no_grad()
    def _native_tables(self, gaussians: Gaussians, want: Want) -> RingTables | None:
        """What the kernel reads, or None where it does not apply: no ring, exact heads, gradients of positions, another
        type, device or size."""
        settings = self.settings
        if settings.evaluation == "exact" or settings.position_gradients or not gaussians.means.is_cpu:
            return None
        tables = self.tables(want)
        return tables if tables is not None and kernel_takes(tables, self.layers_of_shading, gaussians.means) else None

    def _layers(self, gaussians: Gaussians, camera: Camera) -> LitColor:
        tables = self._native_tables(gaussians, Want.EXACT)
        if tables is None:
            return self.reference(gaussians, camera)
        base, latents = self.base(gaussians), self.latents(gaussians)
        parameters = ring_parameters(tables, self.shading, self.layers_of_shading)
        lit = light_layers(self.lit_rows(gaussians, camera), base, latents, parameters)
        return lit if self.shading.gain is None else self.shading.gained(lit, base.sigmoid())

    def _emission_by_torch(self, gaussians: Gaussians, camera: Camera, want: Want) -> Emission:
        def channels(columns: dict[str, Tensor]) -> Channels:
            appearance = {name: columns[name] for name in gaussians.appearance}
            table = replace(gaussians, means=columns.get(MEANS, gaussians.means), appearance=appearance)
            color = self.reference(table, camera).color
            if MASK not in columns:
                return {"rgb": color}
            factor = straight_through_reference(columns[MASK], self.settings.mask_threshold)
            return {"rgb": color, OPACITY_FACTOR: factor[:, None]}

        named = {COLOR + name: parameter for name, parameter in self.named_parameters()}
        followed = {MEANS: gaussians.means} if self.settings.position_gradients else {}
        return emitted_by_torch(channels, followed | gaussians.appearance, named, want)

    def reference(self, gaussians: Gaussians, camera: Camera, gradient_share: float = 1.0) -> LitColor:
        """What the kernel computes, in torch and in any precision: slow, and the judge of the kernel.

        On a GPU field and networks are Triton's. Residual and modulation are zero where the camera cannot see. Here
        ``gradient_share`` saves no time.
        """
        visible = drawable_rows(gaussians, camera).long()
        means, base = self._seen(gaussians.means)[visible], self.base(gaussians).sigmoid()
        directions = view_directions(means, camera.position.to(means))
        points, latents = self.unit_points(means), self.latents(gaussians)[visible]
        tables = None if torch.is_grad_enabled() or self.settings.evaluation == "exact" else self.tables(Want.EXACT)

        def lit_rows() -> LitColor:
            return self.shading(self._features(points, directions, tables), directions, base[visible], latents)

        # On a GPU nothing of a row is kept for the backward pass: kernels make it again sooner than memory is read.
        again = runs_triton(means) and torch.is_grad_enabled()
        lit = checkpoint(lit_rows, use_reentrant=False) if again else lit_rows()
        color = self.shading.shown(base[visible] + importance_sampled(lit.residual, gradient_share))
        return LitColor(
            base.index_put((visible,), color),
            torch.zeros_like(base).index_put((visible,), lit.residual),
            torch.zeros_like(base[:, :1]).index_put((visible,), lit.modulation),
        )

    def _features(
        self, points: Float[Tensor, "V 3"], directions: Float[Tensor, "V 3"], tables: RingTables | None
    ) -> Float[Tensor, "V C"]:
        """Before their tanh, in torch, by ``tables`` made earlier if there are any."""
        if self.settings.evaluation == "exact":
            return self.field.exact(points, directions)
        return tabulated_features(self.field, points, directions, tables)
