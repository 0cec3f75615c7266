"""The loss against a teacher's pictures where there are no photographs, or where they shall not teach."""

from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch
from ringlight.fit.losses.contract import Compared
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.teacher import Teacher
from ringlight.models.contract import Model


class TeacherPictures:
    """The terms of ``photographs``; of a batch that was not photographed, or, ``everywhere``, of any while there is a
    ``teacher``, with what that shows of its camera in place of the photograph.

    Pictures are drawn when they are wanted: most such cameras come once.
    """

    buffers: tuple[str, ...] = ()

    def __init__(self, photographs: PhotographLoss, teacher: Teacher, everywhere: bool):
        self.photographs, self.teacher, self.everywhere = photographs, teacher, everywhere

    @property
    def bytes_kept(self) -> int:
        """Of photographs."""
        return self.photographs.bytes_kept

    def compare(self, prediction: Rendering, batch: ImageBatch, model: Model) -> Compared:
        """See :class:`ringlight.fit.losses.contract.Loss`."""
        if batch.photographed and not (self.everywhere and self.teacher.is_there):
            return self.photographs.compare(prediction, batch, model)
        assert self.teacher.is_there, "nobody photographed this view, and there is no teacher"
        target = Target(self.teacher.picture(batch.camera, batch.background))
        value, gradient = photometric_gradient(prediction.color, target, self.photographs.settings)
        return Compared(value, gradient, target.image.permute(1, 2, 0))
