"""The socket: whatever learns to show a scene. The loop, runs and measurements know no more of a model than this."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.light_features import LightFeatures
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.want import Want
from ringlight.core.words import numbered

if TYPE_CHECKING:
    from ringlight.models.splats import SplatModel


class Count(NamedTuple):
    """What a model is made of: (59125, "Gaussians"), (262144, "voxels")."""

    number: int
    noun: str

    def __str__(self) -> str:
        return numbered(self.number, self.noun)


@runtime_checkable
class Solid(Protocol):
    """Density and colour of a box of space. Places are in the box's [0, 1]^3."""

    box: Tensor
    """Lowest and highest corner [2 3], world units."""

    @property
    def nodes(self) -> tuple[int, int, int]:
        """Along x, y and z, as finely as it can tell places apart."""
        ...

    @property
    def intervals(self) -> tuple[int, int, int]:
        """Along each axis, how often the distance from a node to the next fits into the box: node i lies at i of
        them."""
        ...

    @property
    def surface_density(self) -> float:
        """Where half of the light is lost on the way from a node to the next."""
        ...

    def density_values(self, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """Per unit of length of its own; none where it is known to be empty."""
        ...

    def color(self, places: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """Seen along unit directions, in [0, 1]."""
        ...


@runtime_checkable
class Model(Protocol):
    """An ``nn.Module``; its parameters have one name each in gradients, optimizer, rates, checkpoints and files."""

    row_prefixes: tuple[str, ...]
    """Names of tensors that begin so have one row for each of what :meth:`counted` counts, and as many rows as there
    are; empty where that number never changes."""

    resized_prefixes: tuple[str, ...]
    """Names of tensors that begin so change their shape as a whole while training; :meth:`load_tensors` says whether
    shapes fit each other. Empty where none does."""

    @property
    def device(self) -> torch.device:
        """Where it lies."""
        ...

    @property
    def renderer(self) -> str:
        """What draws it, in words: "cpu rasterizer"."""
        ...

    @property
    def note(self) -> str | None:
        """What is drawn otherwise here than elsewhere, in a sentence."""
        ...

    def predict(self, batch: Any, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        """What it shows of a batch, of the kind that its recipe trains on: a photograph, a crop, or a lot of rays.

        ``buffers`` are what the caller looks at besides colour and alpha.
        """
        ...

    def render(
        self, camera: Camera, background: Float[Tensor, "3"], want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        """One image [H W 3] over ``background``."""
        ...

    def layers(self, camera: Camera) -> Channels:
        """What the picture is made of, over black, [H W c] by name; "alpha" 1 is among them."""
        ...

    def features(self, camera: Camera, background: Float[Tensor, "3"]) -> LightFeatures | None:
        """What its neural light gives to what the camera sees; None without one, or before it is switched on."""
        ...

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        """Raise RecipeError where ``who`` looks at a buffer that no prediction of this model has."""
        ...

    def counted(self) -> Count:
        """What it is made of now."""
        ...

    def bytes_each(self) -> int:
        """Bytes of the parameters of one of these."""
        ...

    def rendering_tensors(self) -> dict[str, Tensor]:
        """What a model file holds: no rows that are never shown, nothing that only training looks at."""
        ...

    def rendering_size(self) -> tuple[Count, int]:
        """Of :meth:`rendering_tensors`, without its copies: what is counted, and bytes with floats at 32 bit."""
        ...

    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """Take the tensors of a file or of a checkpoint, of any number of rows, in place of the present ones."""
        ...

    def splats(self) -> "SplatModel | None":
        """Itself if it is a table of Gaussians, for whatever holds or edits one; else None."""
        ...

    def solid(self) -> "Solid | None":
        """Itself if it has a density everywhere in a box, for whatever looks for its surface; else None."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """All tensors by name."""
        ...

    def parameters(self) -> Iterator[Any]:
        """What is trained."""
        ...

    def named_parameters(self) -> Iterator[tuple[str, Any]]:
        """The same with their names."""
        ...

    def get_parameter(self, target: str) -> Any:
        """The one of this name."""
        ...

    def get_buffer(self, target: str) -> Tensor:
        """A switch, or a box."""
        ...

    def eval(self) -> Any:
        """Itself, for rendering."""
        ...
