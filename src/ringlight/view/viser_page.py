"""The page, by viser: its server, its browsers and their cameras; beside it the panel and the 3D scene.

viser's callbacks run in its server's thread and do nothing but write wishes.
"""

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import Array
from ringlight.view.curves import Curves
from ringlight.view.standpoint import Standpoint, looked_at, standpoint_at
from ringlight.view.subject import Subject
from ringlight.view.viser_panel import ViserPanel
from ringlight.view.viser_server import start_server, stop_server, viser_library
from ringlight.view.viser_world import ViserWorld
from ringlight.view.wishes import Wishes

COARSE_QUALITY, FINAL_QUALITY = 70, 92
"""Of JPEG, 0 to 100: a picture that stays has no blocks that show."""

TOLD_SECONDS = 15.0
"""A sentence stays so long; one on trouble stays until it is closed."""

NEAR_SHARE, FAR_SHARE = 1e-3, 1e3
"""Of the extent: what is drawn of cameras and points lies between."""


class ViserPage:
    """See :class:`ringlight.view.page.Page`."""

    def __init__(self, subject: Subject, wishes: Wishes, host: str, port: int, is_trained: bool):
        """Starts the server. Raises BackendError without viser, RunError for a port in use."""
        self.subject, self.wishes = subject, wishes
        viser = viser_library()
        self.server, self.address = start_server(host, port)
        with self.server.atomic():
            self._start_camera()
            self._world = ViserWorld(self.server.scene, subject, wishes)
            show_cameras = self._world.show_cameras
            self._panel = ViserPanel(viser, self.server.gui, subject, wishes, is_trained, show_cameras)
        self.server.on_client_connect(self._come)
        self.server.on_client_disconnect(self._left)

    # What the viewer asks for

    def show(self, browser: int, picture: UInt8[np.ndarray, "H W 3"] | None, is_final: bool) -> None:
        with self._client(browser) as client:
            quality = FINAL_QUALITY if is_final else COARSE_QUALITY
            client.scene.set_background_image(picture, format="jpeg", jpeg_quality=quality)

    def place(self, browser: int, standpoint: Standpoint, looked_at: Array) -> None:
        with self._client(browser) as client, client.atomic():
            client.camera.position = standpoint.position
            client.camera.up_direction = self._up_of(standpoint)
            client.camera.look_at = looked_at
            client.camera.fov = standpoint.fov

    def tell(self, browser: int, sentence: str, is_trouble: bool = False) -> None:
        with self._client(browser) as client:
            title, color = ("This did not work", "red") if is_trouble else ("ringlight", None)
            stays = None if is_trouble else TOLD_SECONDS
            client.add_notification(title, sentence, auto_close_seconds=stays, color=color)

    def status(self, text: str, is_paused: bool) -> None:
        self._panel.status(text, is_paused)

    def curves(self, curves: Mapping[str, Curves]) -> None:
        self._panel.curves(curves)

    def thumbnail(self, view: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        self._world.thumbnail(view, picture)

    def hide_cameras(self, views: frozenset[str]) -> None:
        self._world.hide_cameras(views)

    def keys(self, cameras: Sequence[Camera], flight: Float[np.ndarray, "F 3"]) -> None:
        self._world.keys(cameras, flight)
        self._panel.key_count(len(cameras))

    def close(self) -> None:
        stop_server(self.server)

    # What browsers say

    async def _come(self, client: Any) -> None:
        # A window higher than wide, or a strip of one, would cut off the sides of what the first camera shows.
        size = int(client.camera.image_width), int(client.camera.image_height)
        strips = self.wishes.look.strips(len(self.subject.sources))
        wanted = standpoint_at(self.subject.start, *size, strips).fov if min(size) > 0 else 0.0
        if wanted > client.camera.fov:
            client.camera.fov = wanted
        self._stand(client)
        client.camera.on_update(self._moved)

    async def _moved(self, camera: Any) -> None:
        self._stand(camera.client)

    async def _left(self, client: Any) -> None:
        self.wishes.leave(client.client_id)

    def _stand(self, client: Any) -> None:
        camera = client.camera
        (x, y, z), (w, i, j, k) = camera.position.tolist(), camera.wxyz.tolist()
        point = Standpoint(
            (x, y, z), (w, i, j, k), float(camera.fov), int(camera.image_width), int(camera.image_height)
        )
        self.wishes.stand(client.client_id, point, time.monotonic())

    def _start_camera(self) -> None:
        subject, start = self.subject, self.server.initial_camera
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        self.server.gui.main_panel.dock_right()  # beside the picture, not over it
        self.server.scene.set_up_direction(subject.up)
        point = standpoint_at(subject.start, subject.start.width, subject.start.height)
        start.position, start.look_at = point.position, looked_at(subject.start, subject.center)
        start.up, start.fov = self._up_of(point), point.fov
        start.near, start.far = NEAR_SHARE * subject.extent, FAR_SHARE * subject.extent

    def _up_of(self, point: Standpoint) -> Array:
        """The scene's up where a camera is level, so that a drag keeps turning round it; else the camera's own."""
        rotation = Rotation.from_quat(point.wxyz, scalar_first=True).as_matrix()
        _, down, forward = rotation.T
        level = self.subject.up - (self.subject.up @ forward) * forward
        length = float(np.linalg.norm(level))
        is_level = length > LEAST_LEVEL and float(level @ -down) / length > MOST_LEVEL
        return self.subject.up if is_level else -down

    @contextlib.contextmanager
    def _client(self, browser: int) -> Iterator[Any]:
        """The browser, if it is still there: else the block runs on a stand-in that hears nothing."""
        client = self.server.get_clients().get(browser)
        yield client if client is not None else _Deaf()


class _Deaf:
    """A browser that was closed: takes anything and does nothing."""

    def __getattr__(self, name: str) -> "_Deaf":
        return self

    def __call__(self, *_: Any, **__: Any) -> "_Deaf":
        return self

    def __enter__(self) -> "_Deaf":
        return self

    def __exit__(self, *_: object) -> None:
        pass


LEAST_LEVEL, MOST_LEVEL = 0.05, 0.9998
"""Sine of the angle between the view and the up axis from which level means anything; cosine of the roll, one degree,
up to which a camera is level."""
