"""The RingLight colour model: a base colour per Gaussian, and a residual from one shared light field."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color.frustum import in_frustum
from ringlight.color.render_module import LitColor, RenderModule
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.color.table_memory import TableMemory
from ringlight.color.visibility_mask import straight_through_mask
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import OPACITY_FACTOR, Channels
from ringlight.core.scene import PointCloud
from ringlight.fields.tensor_ring import RingTables, TensorRing

BASE = "base"
MASK = "mask_logits"

# The logit of pure black or white would be infinite; a quarter of an 8-bit step away still rounds to either.
DARKEST = 0.25 / 255
# sigmoid(1) = 0.73: visible, and where the sigmoid still has a gradient (Compact 3DGS).
FIRST_MASK_LOGIT = 1.0


class RingLight(nn.Module):
    """c(v) = clamp(c_b + c_r(v), 0, 1), with c_r from the neural tensor ring (RingLight-GS, section 3.2).

    Columns: ``base`` [N 3], the base colour's logit, c_b = sigmoid(base); ``mask_logits`` [N], if masked.
    Buffers: ``box`` [low, high], what the ring's [-1, 1]^3 covers, world units; ``lit``, False during the warm-up,
    when Gaussians show their base colour and the field gets no gradient. Positions and directions are detached:
    ten bands would otherwise drown the rasterizer's gradient of the positions.
    """

    box: Tensor
    lit: Tensor
    training_columns = (MASK,)

    def __init__(self, settings: RingLightSettings, box: Float[Tensor, "2 3"], seed: int = 0):
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self.settings = settings
        self.ring = TensorRing(settings.ring, generator)
        self.shading = RenderModule(settings, generator)
        self.register_buffer("box", box.clone().float())
        self.register_buffer("lit", torch.tensor(True))
        self._memory = TableMemory()

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Base colours equal to the points' (black and white to a quarter of an 8-bit step), masks open."""
        columns = {BASE: points.colors.clamp(DARKEST, 1 - DARKEST).logit()}
        if self.settings.mask:
            columns[MASK] = points.colors.new_full((len(points.colors),), FIRST_MASK_LOGIT)
        return columns

    def channels(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "rgb" [N 3] in [0, 1], and "opacity_factor" [N 1], zero or one, if masked.

        Rows that the camera cannot see get their base colour.
        """
        base = gaussians.appearance[BASE]
        channels: Channels = {"rgb": self._emitted(gaussians, camera) if self.lit else base.sigmoid()}
        if MASK in gaussians.appearance:
            channels[OPACITY_FACTOR] = straight_through_mask(gaussians.appearance[MASK], self.settings.mask_threshold)
        return channels

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """Parts of the colour, without gradient: "base" [N 3], "residual" [N 3] signed, "modulation" [N 1].

        Residual and modulation are zero where the camera cannot see, and everywhere during the warm-up.
        """
        base = gaussians.appearance[BASE].sigmoid()
        residual, modulation = torch.zeros_like(base), torch.zeros_like(base[:, :1])
        if self.lit:
            visible = in_frustum(gaussians, camera)
            lit = self._shaded(gaussians, camera, visible)
            residual[visible], modulation[visible] = lit.residual, lit.modulation
        return {"base": base, "residual": residual, "modulation": modulation}

    @torch.no_grad()
    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Rows that the mask leaves visible; a table without masks, as model files hold it, is wanted whole."""
        if MASK not in gaussians.appearance:
            return torch.ones(len(gaussians), dtype=torch.bool)
        return gaussians.appearance[MASK].sigmoid() > self.settings.mask_threshold

    def unit_points(self, means: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """World positions in the ring's coordinates: the box to [-1, 1]^3, clamped, detached."""
        low, high = self.box.to(means)
        return ((means.detach() - low) * (2 / (high - low)) - 1).clamp(-1, 1)

    def tables(self) -> RingTables:
        """The ring's tables: made anew where gradients are recorded, else kept until a parameter's value changes."""
        if torch.is_grad_enabled():
            return self.ring.tables()
        return self._memory.recall(self.ring.parameters(), self.ring.tables)

    def _emitted(self, gaussians: Gaussians, camera: Camera) -> Float[Tensor, "N 3"]:
        visible = in_frustum(gaussians, camera)
        lit = self._shaded(gaussians, camera, visible)
        color = gaussians.appearance[BASE].sigmoid()
        return color.index_put((visible.nonzero()[:, 0],), lit.color)

    def _shaded(self, gaussians: Gaussians, camera: Camera, visible: Bool[Tensor, "N"]) -> LitColor:
        """Colour of the visible rows, in torch: the slow twin of the kernel."""
        means = gaussians.means.detach()[visible]
        directions = view_directions(means, camera.position.to(means))
        points = self.unit_points(means)
        if self.settings.evaluation == "exact":
            features = self.ring.exact(points, directions)
        else:
            features = self.ring.tabulated(points, directions, self.tables())
        return self.shading(features, directions, gaussians.appearance[BASE][visible].sigmoid())
