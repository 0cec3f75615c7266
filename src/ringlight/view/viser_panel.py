"""The panel of controls on the viewer's page, by viser: every control leaves a wish.

All text goes into plain fields: viser would run what markdown holds, and names of files are anybody's.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ringlight.view.curves import CHARTS, Curves, chart_data
from ringlight.view.key_frames import FILES, LONGEST, SHORTEST
from ringlight.view.model_picture import BRIGHTEST
from ringlight.view.subject import Subject
from ringlight.view.wishes import ALL, ARRANGEMENTS, Ask, Wishes

CHART_HEIGHT = 140
"""Pixels."""

LINES = ("#2f6fb7", "#c2531b", "#3c8a4e", "#8a4fa3", "#a38a1c", "#4d5a66")
"""Colours of runs in a chart; those beyond begin again."""


class ViserPanel:
    """Of one page; the checkbox that shows cameras calls ``show_cameras``."""

    def __init__(
        self,
        viser: Any,
        gui: Any,
        subject: Subject,
        wishes: Wishes,
        is_trained: bool,
        show_cameras: Callable[[bool], None],
    ):
        self.subject, self.wishes = subject, wishes
        self._charts: list[Any] = []
        self._status = gui.add_text("showing", subject.title, multiline=True, disabled=True)
        if subject.sources:
            self._add_look(gui)
        if subject.sources_shown:
            self._add_comparison(gui)
        if subject.views:
            self._add_views(gui, show_cameras)
        self._add_training(gui, viser.uplot, is_trained)
        self._add_film(gui)

    def status(self, text: str, is_paused: bool) -> None:
        """See :class:`ringlight.view.page.Page`, as the next."""
        self._status.value = text
        self._pause.label = "continue" if is_paused else "pause"

    def curves(self, curves: Mapping[str, Curves]) -> None:
        """A run without any leaves its line away."""
        data_of = chart_data(curves, list(self.subject.sources)) if self._charts else []
        for chart, data in zip(self._charts, data_of, strict=True):
            if data is not None:
                chart.data, chart.visible, self._training.visible = data, True, True

    def key_count(self, count: int) -> None:
        """How many key frames there are."""
        self._key_count.value = f"{count}"

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

    def _add_views(self, gui: Any, show_cameras: Callable[[bool], None]) -> None:
        with gui.add_folder("cameras"):
            seen = gui.add_checkbox("show cameras", not self.subject.sources)
            names = gui.add_dropdown("camera", tuple(self.subject.views))
            go = gui.add_button("go there", hint="or click a camera in the picture")
            go.on_click(self._ask(Ask.GO_TO_VIEW, lambda: names.value))

        @seen.on_update
        async def _(event: Any) -> None:
            show_cameras(event.target.value)

    def _add_training(self, gui: Any, uplot: Any, is_trained: bool) -> None:
        """Buttons of a training here; curves of any."""
        with gui.add_folder("training", visible=is_trained) as self._training:
            self._pause = gui.add_button("pause", visible=is_trained)
            self._pause.on_click(self._pause_or_go_on)
            hint = "the checkpoint and the model, as they are now"
            gui.add_button("save", hint=hint, visible=is_trained).on_click(self._ask(Ask.SAVE))
            names = list(self.subject.sources)
            lines = [uplot.Series(label=name, stroke=LINES[i % len(LINES)], width=2) for i, name in enumerate(names)]
            nothing = (np.zeros(1),) * (1 + len(names))
            for title in CHARTS if names else ():
                series, scales = (uplot.Series(label="step"), *lines), {"x": uplot.Scale(time=False)}
                chart = gui.add_uplot(nothing, series, title=title, scales=scales, height=CHART_HEIGHT, visible=False)
                self._charts.append(chart)

    def _add_film(self, gui: Any) -> None:
        with gui.add_folder("film", expand_by_default=False):
            self._key_count = gui.add_text("key frames", "0", disabled=True)
            gui.add_button("add key frame").on_click(self._ask(Ask.ADD_KEY))
            gui.add_button("drop the last").on_click(self._ask(Ask.DROP_KEY))
            seconds = gui.add_number("seconds", 6.0, min=SHORTEST, max=LONGEST, step=0.5)
            gui.add_button("preview").on_click(self._ask(Ask.PLAY, lambda: seconds.value))
            gui.add_button("stop").on_click(self._ask(Ask.STOP))
            hint = "both make the film of the preview; key frames can be edited, see docs/render.md"
            holds = gui.add_dropdown("file of", FILES, initial_value=FILES[0], hint=hint)
            gui.add_button("write").on_click(self._ask(Ask.WRITE_PATH, lambda: (seconds.value, holds.value)))
