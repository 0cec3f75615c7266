"""The parts of the page that several runs share: table, charts, test views, layers."""

from collections.abc import Sequence

from ringlight.core.visible_text import visible
from ringlight.core.words import counted
from ringlight.measure.columns import MISSING
from ringlight.measure.table import ResultsTable
from ringlight.pages.markup import Html, element, joined, name
from ringlight.pages.report.charts import Chart, Curve, dot, drawable, drawn, training_charts
from ringlight.pages.report.encoded import scale_url
from ringlight.pages.report.groups import Group, Member
from ringlight.pages.report.layers import CAPTIONS, LayersShown, layer_names
from ringlight.pages.report.views import RunPicture, ViewShown, ViewsShown, ranked


def table(results: ResultsTable) -> Html:
    """Runs of one group: all columns that any of them has; the best is marked."""
    grid = results.grid().without("scene")
    head = element("tr", *(element("th", column.title, class_=_kind(column.is_name)) for column in grid.columns))
    bodies = []
    for scene in grid.scenes:
        rows = []
        for row in scene:
            cells = []
            for column, cell in zip(grid.columns, row, strict=True):
                kind = " ".join(filter(None, (_kind(column.is_name), "best" if cell.best else "")))
                faint = cell.text == MISSING
                text = name(cell.text) if column.is_name else cell.text
                cells.append(element("td", text, class_=f"{kind} faint" if faint else kind))
            rows.append(element("tr", *cells))
        bodies.append(element("tbody", *rows))
    notes = [element("li", note) for note in results.notes()]
    whole = element("div", element("table", element("thead", head), *bodies, class_="results"), class_="wide")
    return joined([whole, element("ul", *notes, class_="notes")] if notes else [whole])


def _kind(is_name: bool) -> str:
    return "" if is_name else "number"


def legend(members: Sequence[Member]) -> Html:
    """Which colour is which run's."""
    keys = [element("span", dot(one.index), name(one.label)) for one in members]
    return element("p", *keys, class_="legend")


def trainings(group: Group, key: str) -> Html:
    """Charts over steps and over seconds, of which one set is shown at a time."""
    runs = [(one.label, one.index, one.run.curve) for one in group.members if one.run.curve]
    if not runs:
        return element("p", "No run of this scene knows how its training went.", class_="faint")
    nouns = " and ".join(dict.fromkeys(one.run.report.noun for one in group.members if one.run.report)) or "Gaussians"
    sets = [element("div", *map(drawn, training_charts(runs, nouns, over)), class_="charts") for over in (False, True)]
    choices = []
    for index, text in enumerate(("over steps", "over seconds")):
        button = f"{key}-axis{index}"
        choice = element(
            "input", type="radio", name=f"{key}-axis", id=button, class_=f"axis{index}", checked=index == 0
        )
        choices += [choice, element("label", text, for_=button)]
    missing = [one.label for one in group.members if not one.run.curve]
    notes = (
        [element("p", "Without a curve: ", joined([name(label) for label in missing]), class_="faint")]
        if missing
        else []
    )
    about = (
        "Each point of PSNR and loss is the mean over up to four training photographs, before their step: "
        "fewer in a short run."
    )
    note = element("p", about, class_="faint")
    return element("div", *choices, legend(group.members), *sets, note, *notes, class_="switched")


def views_chart(group: Group) -> Html:
    """The PSNR of every test view, from the worst to the best."""
    names = ranked(group)
    curves = []
    for member, run in group.measured:
        of_view = {image.name: image.psnr for image in run.report.images}
        places = [(rank, of_view[name]) for rank, name in enumerate(names) if name in of_view]
        finite = [(float(rank), psnr) for rank, psnr in places if drawable(psnr)]
        if finite:
            curves.append(Curve(member.label, member.index, *map(tuple, zip(*finite, strict=True))))
    if not curves:
        return Html("")
    title = f"PSNR of {counted(len(names), 'test view')}, dB"
    chart = drawn(Chart(title, "worst to best", tuple(curves), tuple(names), dotted=True))
    return joined([legend([member for member, _ in group.measured]), element("div", chart, class_="charts")])


def view_cards(group: Group, shown: ViewsShown, key: str) -> Html:
    """Cards of the chosen views under the chart of all; nothing where the scene has no test views."""
    chart = views_chart(group)
    if not (chart or shown.views or shown.notes):
        return Html("")
    parts = [element("h3", "Test views"), chart]
    parts += [element("p", note, class_="trouble") for note in shown.notes]
    if shown.views:
        about = (
            "Left of the line is the photograph, right of it the picture: drag it. With each picture is its error, "
            "the mean over red, green and blue of |picture - photograph|, on one scale from 0 (black) to "
            f"{shown.top:g} (cream)."
        )
        parts.append(element("p", about, class_="faint"))
        if len(shown.views[0].runs) > 1:
            parts.append(_left_side(shown.views[0], key))
        ramp = element("img", src=scale_url(), alt="from black over red to cream", width=256, height=12, class_="ramp")
        ends = element("figcaption", "error 0", element("span", f"{shown.top:g}"), class_="ends")
        parts += [_card(view, f"{key}v{view.rank}", joined([ramp, ends])) for view in shown.views]
    return element("section", *parts, class_="views", id=key)


def _left_side(view: ViewShown, key: str) -> Html:
    """What is left of the line: the photograph, or another run's picture. Works with the page's script alone."""
    options = [element("option", "photograph", value="photograph")]
    options += [element("option", run.member.label, value=str(run.member.index)) for run in view.runs]
    select = element("select", *options, data_for=key)
    return element("p", element("label", "Left of the line: ", select), class_="scripted")


def _card(view: ViewShown, key: str, scale: Html) -> Html:
    size = {"width": view.width, "height": view.height}
    mean = sum(run.psnr for run in view.runs) / len(view.runs)
    ends = {} if view.of == 1 else {0: "worst view", view.of - 1: "best view"}
    place = ends.get(view.rank, "the only view" if view.of == 1 else f"{view.rank + 1} of {view.of}")
    words = element("h4", name(view.name), element("span", f"{place}, {mean:.2f} dB", class_="faint"))
    alone = len(view.runs) == 1
    photograph = element(
        "figure",
        element("figcaption", "photograph"),
        element("img", src=view.photograph, alt="photograph", id=f"{key}-photograph", **size),
        *(() if alone else (element("div", scale, class_="error"),)),
        class_="photograph",
    )
    best = None if alone else max(run.psnr for run in view.runs)
    errors = [element("img", src=run.error, alt="error", class_="error", decoding="async", **size) for run in view.runs]
    if alone:  # its error map stands beside the picture, where other runs' pictures would
        shots = [
            _shot(view.runs[0], key, best, size),
            element("figure", element("figcaption", "error"), *errors, scale),
        ]
    else:
        shots = [_shot(run, key, best, size, error) for run, error in zip(view.runs, errors, strict=True)]
    return element("article", words, element("div", photograph, *shots, class_="shots"), class_="view", data_key=key)


def _shot(run: RunPicture, key: str, best: float | None, size: dict[str, int], *below: Html) -> Html:
    number = f"{run.psnr:.2f} dB"
    psnr = element("b", number, class_="best") if run.psnr == best else element("span", number)
    picture = element("img", src=run.picture, alt="picture", id=f"{key}-{run.member.index}", **size)
    label = element("figcaption", dot(run.member.index), name(run.member.label), " ", psnr)
    return element("figure", label, element("div", picture, class_="curtain"), *below)


def layers(shown: Sequence[LayersShown], troubles: Sequence[str]) -> Html:
    """One row a run, one column a layer."""
    parts = [element("h3", "Layers"), *(element("p", trouble, class_="trouble") for trouble in troubles)]
    if not shown:
        return element("section", *parts)
    first = shown[0]
    about = f"Training camera {first.camera + 1} of {first.of} of {visible(first.member.label)}"
    about += ", drawn by each run's model." if len(shown) > 1 else "."
    parts.append(element("p", about, class_="faint"))
    for one in shown:
        parts.append(element("h4", dot(one.member.index), name(one.member.label)))
        figures = [
            element(
                "figure",
                element("img", src=one.pictures[layer], alt=CAPTIONS[layer], decoding="async"),
                element("figcaption", CAPTIONS[layer]),
            )
            for layer in layer_names([one])
        ]
        parts.append(element("div", *figures, class_="layers"))
    return element("section", *parts)
