"""The page, by viser: the only file that builds its controls and sends it anything.

viser's callbacks run in its server's thread and do nothing but write wishes. All text goes into plain fields: viser
would run what markdown holds, and names of files are anybody's.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import Array, position_of, rotation_of
from ringlight.view.key_frames import LONGEST, SHORTEST
from ringlight.view.model_picture import BRIGHTEST
from ringlight.view.page import Curves
from ringlight.view.standpoint import Standpoint, looked_at, standpoint_at
from ringlight.view.subject import Subject
from ringlight.view.viser_server import start_server, stop_server, viser_library
from ringlight.view.wishes import ALL, ARRANGEMENTS, Ask, Wishes

COARSE_QUALITY, FINAL_QUALITY = 70, 92
"""Of JPEG, 0 to 100: a picture that stays has no blocks that show."""

TOLD_SECONDS = 15.0
"""A sentence stays so long; one on trouble stays until it is closed."""

CAMERA_SHARE = 0.05
"""Length of a drawn camera as a share of the scene's extent."""

KEY_COLOR, VIEW_COLOR = (220, 60, 30), (60, 110, 200)

MOST_CAMERAS = 300
"""Drawn ones: each is an object of its own in the browser."""

MOST_POINTS = 200_000
"""Of a scene's points, evenly chosen."""

NEAR_SHARE, FAR_SHARE = 1e-3, 1e3
"""Of the extent: what is drawn of cameras and points lies between."""

CHART_HEIGHT = 140
"""Pixels."""


class ViserPage:
    """See :class:`ringlight.view.page.Page`."""

    def __init__(self, subject: Subject, wishes: Wishes, host: str, port: int, is_trained: bool):
        """Starts the server. Raises BackendError without viser, RunError for a port in use."""
        self.subject, self.wishes = subject, wishes
        self.viser = viser_library()
        self.server, self.address = start_server(host, port)
        self._frustums: dict[str, Any] = {}
        self._hidden: frozenset[str] = frozenset()
        self._key_nodes: list[Any] = []
        self._charts: list[Any] = []
        with self.server.atomic():
            self._start_camera()
            self._add_controls(is_trained)
            self._add_cameras()
            self._add_points()
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
        self._status.value = text
        self._pause.label = "continue" if is_paused else "pause"

    def curves(self, curves: Curves) -> None:
        for chart, steps, values in zip(
            self._charts,
            (curves.psnr_steps, curves.loss_steps, curves.psnr_steps),
            (curves.psnr, curves.loss, curves.counted),
            strict=False,
        ):
            if steps:
                chart.data = (np.array(steps, dtype=np.float64), np.array(values, dtype=np.float64))
                chart.visible = True

    def thumbnail(self, view: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        if view in self._frustums:
            self._frustums[view].image = picture

    def hide_cameras(self, views: frozenset[str]) -> None:
        for name in views ^ self._hidden:
            if name in self._frustums:
                self._frustums[name].visible = name not in views
        self._hidden = views

    def keys(self, cameras: Sequence[Camera], flight: Float[np.ndarray, "F 3"]) -> None:
        for node in self._key_nodes:
            node.remove()
        self._key_nodes = [self._frustum(f"/keys/{index}", camera, KEY_COLOR) for index, camera in enumerate(cameras)]
        if len(flight):
            ends = np.stack([flight[:-1], flight[1:]], 1).astype(np.float32)
            self._key_nodes.append(
                self.server.scene.add_line_segments(
                    "/flight", ends, np.array(KEY_COLOR), thickness=2.0, thickness_units="screen"
                )
            )
        self._key_count.value = f"{len(cameras)}"

    def close(self) -> None:
        stop_server(self.server)

    # What browsers say

    async def _come(self, client: Any) -> None:
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

    def _wish(self, field: str) -> Callable[[Any], Any]:
        async def changed(event: Any) -> None:
            self.wishes.wish(field, event.target.value)

        return changed

    def _ask(self, what: Ask, value: Callable[[], Any] = lambda: None) -> Callable[[Any], Any]:
        async def clicked(event: Any) -> None:
            self.wishes.ask(what, event.client_id, value())

        return clicked

    async def _pause_or_go_on(self, event: Any) -> None:
        self.wishes.ask(Ask.PAUSE if self._pause.label == "pause" else Ask.CONTINUE, event.client_id)

    # What is on the page

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

    def _add_controls(self, is_trained: bool) -> None:
        gui = self.server.gui
        self._status = gui.add_text("showing", self.subject.title, multiline=True, disabled=True)
        if self.subject.sources:
            self._add_look(gui)
        if self.subject.sources_shown:
            self._add_comparison(gui)
        if self.subject.views:
            self._add_views(gui)
        self._add_training(gui, is_trained)
        self._add_film(gui)

    def _add_look(self, gui: Any) -> None:
        look = self.wishes.look
        with gui.add_folder("picture"):
            layer = gui.add_dropdown("layer", self.subject.layers, initial_value=look.layer)
            layer.on_update(self._wish("layer"))
            hint = "factor on what depends on the view: 0 is the base colour alone, 1 the picture as it is"
            light = gui.add_slider("light", 0.0, BRIGHTEST, 0.05, look.light, hint=hint)
            light.on_update(self._wish("light"))

    def _add_comparison(self, gui: Any) -> None:
        shown, look = self.subject.sources_shown, self.wishes.look
        arrangements = [name for name in ARRANGEMENTS if name != ALL or len(self.subject.sources) > 1]
        with gui.add_folder("compare", visible=len(shown) > 1):
            choice = gui.add_dropdown("show", arrangements, initial_value=look.arrangement)
            choice.on_update(self._wish("arrangement"))
            for side in ("left", "right"):
                source = gui.add_dropdown(side, shown, initial_value=getattr(look, side))
                source.on_update(self._wish(side))
            curtain = gui.add_slider("curtain", 0.0, 1.0, 0.01, look.curtain)
            curtain.on_update(self._wish("curtain"))

    def _add_views(self, gui: Any) -> None:
        with gui.add_folder("cameras"):
            seen = gui.add_checkbox("show cameras", not self.subject.sources)
            names = gui.add_dropdown("camera", tuple(self.subject.views))
            go = gui.add_button("go there", hint="or click a camera in the picture")
            go.on_click(self._ask(Ask.GO_TO_VIEW, lambda: names.value))

        @seen.on_update
        async def _(event: Any) -> None:
            self._cameras.visible = event.target.value

    def _add_training(self, gui: Any, is_trained: bool) -> None:
        with gui.add_folder("training", visible=is_trained):
            self._pause = gui.add_button("pause")
            self._pause.on_click(self._pause_or_go_on)
            save = gui.add_button("save", hint="the checkpoint and the model, as they are now")
            save.on_click(self._ask(Ask.SAVE))
            uplot = self.viser.uplot
            nothing = (np.zeros(1), np.zeros(1))
            for label in ("training PSNR, dB", "loss", "size") if is_trained else ():
                series = (uplot.Series(label="step"), uplot.Series(label=label, stroke="#2f6fb7", width=2))
                scales = {"x": uplot.Scale(time=False)}
                chart = gui.add_uplot(nothing, series, title=label, scales=scales, height=CHART_HEIGHT, visible=False)
                self._charts.append(chart)

    def _add_film(self, gui: Any) -> None:
        with gui.add_folder("film", expand_by_default=False):
            self._key_count = gui.add_text("key frames", "0", disabled=True)
            gui.add_button("add key frame").on_click(self._ask(Ask.ADD_KEY))
            gui.add_button("drop the last").on_click(self._ask(Ask.DROP_KEY))
            seconds = gui.add_number("seconds", 6.0, min=SHORTEST, max=LONGEST, step=0.5)
            gui.add_button("preview").on_click(self._ask(Ask.PLAY, lambda: seconds.value))
            gui.add_button("stop").on_click(self._ask(Ask.STOP))
            gui.add_button("write").on_click(self._ask(Ask.WRITE_PATH, lambda: seconds.value))

    def _add_cameras(self) -> None:
        self._cameras = self.server.scene.add_frame("/cameras", show_axes=False, visible=not self.subject.sources)
        names = list(self.subject.views)
        step = max(math.ceil(len(names) / MOST_CAMERAS), 1)
        for index, name in enumerate(names[::step]):
            frustum = self._frustum(f"/cameras/{index}", self.subject.views[name], VIEW_COLOR)
            frustum.on_click(self._ask(Ask.GO_TO_VIEW, partial(str, name)))
            self._frustums[name] = frustum

    def _frustum(self, node: str, camera: Camera, color: tuple[int, int, int]) -> Any:
        x, y, z, w = Rotation.from_matrix(rotation_of(camera).T).as_quat()
        return self.server.scene.add_camera_frustum(
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
        self.server.scene.add_point_cloud(
            "/points", points.positions[::step].numpy(), colors, point_size=size, precision="float32"
        )

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

POINT_SHARE = 0.004
"""Size of a point as a share of the extent."""
