"""The 3D scene on the viewer's page, by viser: cameras with their photographs, key frames, points."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import position_of, rotation_of
from ringlight.view.subject import Subject
from ringlight.view.wishes import Ask, Wishes

CAMERA_SHARE = 0.05
"""Length of a drawn camera as a share of the scene's extent."""

KEY_COLOR, VIEW_COLOR = (220, 60, 30), (60, 110, 200)

MOST_POINTS = 200_000
"""Of a scene's points, evenly chosen."""

POINT_SHARE = 0.004
"""Size of a point as a share of the extent."""


class ViserWorld:
    """Of one page; a click at a camera is a wish to go there."""

    def __init__(self, nodes: Any, subject: Subject, wishes: Wishes):
        self._nodes, self.subject, self.wishes = nodes, subject, wishes
        self._frustums: dict[str, Any] = {}
        self._hidden: frozenset[str] = frozenset()
        self._key_nodes: list[Any] = []
        self._add_cameras()
        self._add_points()

    def show_cameras(self, are_shown: bool) -> None:
        """All, or none."""
        self._cameras.visible = are_shown

    def thumbnail(self, view: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        """See :class:`ringlight.view.page.Page`, as the next."""
        if view in self._frustums:
            self._frustums[view].image = picture

    def hide_cameras(self, views: frozenset[str]) -> None:
        """All but these are drawn."""
        for name in views ^ self._hidden:
            if name in self._frustums:
                self._frustums[name].visible = name not in views
        self._hidden = views

    def keys(self, cameras: Sequence[Camera], flight: Float[np.ndarray, "F 3"]) -> None:
        """Key frames, and the way between them."""
        for node in self._key_nodes:
            node.remove()
        self._key_nodes = [self._frustum(f"/keys/{index}", camera, KEY_COLOR) for index, camera in enumerate(cameras)]
        if len(flight):
            ends = np.stack([flight[:-1], flight[1:]], 1).astype(np.float32)
            self._key_nodes.append(
                self._nodes.add_line_segments(
                    "/flight", ends, np.array(KEY_COLOR), thickness=2.0, thickness_units="screen"
                )
            )

    def _add_cameras(self) -> None:
        self._cameras = self._nodes.add_frame("/cameras", show_axes=False, visible=not self.subject.sources)
        for index, name in enumerate(self.subject.drawn_views):
            frustum = self._frustum(f"/cameras/{index}", self.subject.views[name], VIEW_COLOR)
            frustum.on_click(self._going_to(name))
            self._frustums[name] = frustum

    def _going_to(self, view: str) -> Callable[[Any], Any]:
        async def clicked(event: Any) -> None:
            self.wishes.ask(Ask.GO_TO_VIEW, event.client_id, view)

        return clicked

    def _frustum(self, node: str, camera: Camera, color: tuple[int, int, int]) -> Any:
        x, y, z, w = Rotation.from_matrix(rotation_of(camera).T).as_quat()
        return self._nodes.add_camera_frustum(
            node,
            2 * math.atan(camera.height / 2 / camera.focal[1]),
            camera.width / camera.height * camera.focal[1] / camera.focal[0],
            scale=CAMERA_SHARE * self.subject.extent,
            thickness=1.5,
            thickness_units="screen",
            color=color,
            wxyz=(w, x, y, z),
            position=position_of(camera),
        )

    def _add_points(self) -> None:
        points = self.subject.points
        if points is None or not len(points.positions):
            return
        step = math.ceil(len(points.positions) / MOST_POINTS)
        colors = (points.colors[::step].clamp(0, 1) * 255).round().byte().numpy()
        size = POINT_SHARE * self.subject.extent
        # In half precision far points would lie on a lattice that shows.
        self._nodes.add_point_cloud(
            "/points", points.positions[::step].numpy(), colors, point_size=size, precision="float32"
        )
