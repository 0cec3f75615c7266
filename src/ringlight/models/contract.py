"""The socket: whatever learns to show a scene. The loop, runs and measurements know no more of a model than this."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.want import Want


@runtime_checkable
class Model(Protocol):
    """An ``nn.Module``, whose parameters have one name each in optimizer, rates, checkpoints and model files."""

    @property
    def device(self) -> torch.device:
        """Where the parameters are."""
        ...

    def predict(self, batch: Any, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        """What it shows of a batch: a photograph, a crop, or a lot of rays; the kind that its recipe trains on."""
        ...

    def render(
        self, camera: Camera, background: Float[Tensor, "3"], want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        """One image [H W 3] over ``background``."""
        ...

    def layers(self, camera: Camera) -> Channels:
        """What the picture is made of, over black, [H W c] by name; "alpha", "depth" and "normal" are among it."""
        ...

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        """Raise RecipeError where ``who`` looks at a buffer that no prediction of this model has."""
        ...

    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """Take a whole ``state_dict``, of any sizes that the model may have."""
        ...

    def state_dict(self) -> dict[str, Tensor]: ...

    def parameters(self) -> Iterator[Any]: ...

    def named_parameters(self) -> Iterator[tuple[str, Any]]: ...

    def get_parameter(self, target: str) -> Any: ...

    def get_buffer(self, target: str) -> Tensor: ...
