"""The loss against a teacher's pictures, where there is a teacher; against photographs before it comes, and after."""

from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch
from ringlight.fit.losses.contract import Compared
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.teacher import Teacher
from ringlight.models.contract import Model


class TeacherPictures:
    """The terms of ``photographs`` with what the ``teacher`` shows of the batch's camera in place of the photograph.

    Pictures are drawn when they are wanted: most cameras come once.
    """

    buffers: tuple[str, ...] = ()

    def __init__(self, photographs: PhotographLoss, teacher: Teacher):
        self.photographs, self.teacher = photographs, teacher

    @property
    def bytes_kept(self) -> int:
        """Of photographs."""
        return self.photographs.bytes_kept

    def compare(self, prediction: Rendering, batch: ImageBatch, model: Model) -> Compared:
        """See :class:`ringlight.fit.losses.contract.Loss`."""
        if not self.teacher.is_there:
            return self.photographs.compare(prediction, batch, model)
        target = Target(self.teacher.picture(batch.camera, batch.background))
        value, gradient = photometric_gradient(prediction.color, target, self.photographs.settings)
        return Compared(value, gradient, target.image.permute(1, 2, 0))
