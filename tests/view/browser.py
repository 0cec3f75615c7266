"""A browser as the viewer's server sees it: a websocket that speaks viser's messages."""

import io
import time
from typing import Any

import numpy as np
from PIL import Image

from ringlight.view.standpoint import Standpoint

PATIENCE = 10
"""Times a pause between two messages that is waited for."""


class Browser:
    """Connects to ``address``, as a page of ``origin``; by default of its own."""

    def __init__(self, address: str, origin: str | None = None, **headers: str):
        import viser
        from websockets.sync.client import connect

        place = address.removeprefix("http://")
        self.socket = connect(
            f"ws://{place}",
            origin=origin or address,
            subprotocols=[f"viser-v{viser.__version__}"],
            max_size=None,
            compression=None,
            additional_headers=headers,
        )
        self.messages: list[dict[str, Any]] = []

    def say(self, kind: str, **fields: Any) -> None:
        import msgspec

        self.socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def stand(self, point: Standpoint) -> None:
        """Report the camera."""
        self.say(
            "ViewerCameraMessage",
            wxyz=point.wxyz,
            position=point.position,
            fov=point.fov,
            near=0.01,
            far=100.0,
            image_height=point.height,
            image_width=point.width,
            look_at=(0.0, 0.0, 0.0),
            up_direction=(0.0, 0.0, 1.0),
        )

    def set(self, label: str, value: Any) -> None:
        """Move a control, or press a button where the value is True."""
        self.say("GuiUpdateMessage", uuid=self.control(label), updates={"value": value})

    def press(self, label: str) -> None:
        self.set(label, True)

    def control(self, label: str) -> str:
        made = [m for m in self.messages if m["type"].startswith("Gui") and m.get("props", {}).get("label") == label]
        return made[-1]["uuid"]

    def listen(self, seconds: float) -> None:
        """Take what comes until nothing has for so long, or for PATIENCE times as long: a training may never pause."""
        import msgspec
        import zstandard

        end = time.monotonic() + PATIENCE * seconds
        while time.monotonic() < end:
            try:
                data = self.socket.recv(timeout=seconds)
            except TimeoutError:
                return
            inner, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
            body = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=inner)
            self.messages += msgspec.msgpack.decode(body)["messages"]

    def last(self, kind: str) -> dict[str, Any] | None:
        """The last message of a kind that has come."""
        return next((message for message in reversed(self.messages) if message["type"] == kind), None)

    @property
    def picture(self) -> np.ndarray | None:
        """The last that filled the window."""
        shown = self.last("BackgroundImageMessage")
        if shown is None or shown["rgb_data"] is None:
            return None
        with Image.open(io.BytesIO(shown["rgb_data"])) as image:
            return np.array(image.convert("RGB"))

    def close(self) -> None:
        self.socket.close()
