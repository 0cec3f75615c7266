"""``ringlight report``: one page of whatever the run folders still hold."""

import json
import shutil
from pathlib import Path

import pytest
from cli_session import QUICK
from command import Command
from parsed import Parsed, assert_loads_nothing
from refusal import refused, snapshot
from scenes_on_disk import edit_json, write_tiny_scene

from ringlight.cli.main import run as run_command
from ringlight.measure.picture_names import RENDERS

LAYERS = {"3dgs": 5, "ringlight-ring": 6}
"""Of both models, the picture included: the ring has a light modulation too."""


def read(page: Path) -> Parsed:
    parsed = Parsed(page.read_text(encoding="utf-8"))
    assert_loads_nothing(parsed)
    return parsed


def copy(run: Path, where: Path) -> Path:
    return Path(shutil.copytree(run, where))


def test_two_runs_stand_side_by_side(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    page = tmp_path / "out.html"
    done = ringlight("report", trained["3dgs"], trained["ringlight-ring"], page)
    assert done.code == 0, done.err
    assert done.out == f"{page}\n"
    assert f"{page.stat().st_size / 1e6:.2f} MB" in done.err
    shown = read(page)
    report = json.loads((trained["3dgs"] / "report.json").read_text())
    assert f"{report['psnr']:.2f}" in shown.texts
    views = len(report["images"])
    cards = [a for a in shown.all("article")]
    assert len(cards) == min(views, 6)
    alts = [image["alt"] for image in shown.all("img")]
    assert (alts.count("photograph"), alts.count("picture"), alts.count("error")) == (views, 2 * views + 2, 2 * views)
    assert len(shown.all("svg")) == 2 * 3 + 1, "three charts over steps, three over seconds, one of views"
    for curve in [a for a in shown.all("g") if "data-values" in a][:2]:
        values = json.loads(curve["data-values"] or "")
        of_run = json.loads((trained[curve["data-label"] or ""] / "report.json").read_text())["curve"]
        assert [x for x, _ in values] == [point["step"] for point in of_run]
    assert report["machine"]["cpu"] in shown.text
    assert "ringlight train" in shown.text
    assert "densify.threshold" in shown.text
    layers = [
        a["alt"] for a in shown.all("img") if a["alt"] in ("base colour", "light modulation", "depth, near is light")
    ]
    assert layers.count("depth, near is light") == 2
    assert layers.count("light modulation") == 1


def test_the_same_runs_give_the_same_page(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page in pages:
        assert ringlight("report", trained["3dgs"], page, "--no-layers").code == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_views_bound_the_page(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    sizes = []
    for views in (0, 1, 2):
        page = tmp_path / f"{views}.html"
        assert ringlight("report", trained["3dgs"], page, "--no-layers", "--views", views).code == 0
        assert len(read(page).all("article")) == views
        sizes.append(page.stat().st_size)
    assert sizes == sorted(sizes)


def test_a_run_is_never_changed(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    before = snapshot(trained["3dgs"])
    assert ringlight("report", trained["3dgs"], tmp_path / "out.html").code == 0
    assert snapshot(trained["3dgs"]) == before


HOSTILE = "</script><script>alert('x')</script>\"\u202egnp"


def test_hostile_names_are_text(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = copy(trained["3dgs"], tmp_path / "run <b> & \u202e'x'")

    def spoil(report: dict) -> None:
        report.update(scene=HOSTILE, preset=HOSTILE, method=HOSTILE, notes=[HOSTILE], noun=HOSTILE, lpips_note=HOSTILE)
        report["machine"].update(cpu=HOSTILE)
        report["images"][0]["name"] = HOSTILE

    edit_json(run / "report.json", spoil)
    page = tmp_path / "out.html"
    done = ringlight("report", run, trained["3dgs"], page)
    assert done.code == 0, done.err
    shown = read(page)
    assert len(shown.all("script")) == 1
    assert not shown.all("b") or all("class" in b for b in shown.all("b"))
    assert "\u202e" not in page.read_text(encoding="utf-8")
    assert "</script><script>alert('x')</script>\"\\u202egnp" in shown.texts


def test_an_unfinished_run_shows_its_curve_so_far(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = copy(trained["3dgs"], tmp_path / "run")
    (run / "report.json").unlink()
    page = tmp_path / "out.html"
    done = ringlight("report", run, trained["ringlight-basis"], page)
    assert done.code == 0, done.err
    assert "has no report.json" in done.err
    assert f"ringlight train --resume {run}" in done.err
    shown = read(page)
    labels = {curve["data-label"] for curve in shown.all("g") if "data-label" in curve}
    assert labels == {"3dgs", "ringlight-basis"}, "its curve comes from the checkpoint"
    assert shown.text.count("has no report.json") == 1
    (run / "recipe.json").write_text("{")
    assert "go on with" not in ringlight("report", run, tmp_path / "no-record.html", "--no-layers").err


@pytest.mark.parametrize("file", ["report.json", "recipe.json", "model.safetensors", "checkpoint.safetensors"])
def test_a_damaged_run_is_shown_as_far_as_it_goes(
    file: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = copy(trained["3dgs"], tmp_path / "run")
    (run / file).write_bytes((run / file).read_bytes()[:100])
    page = tmp_path / "out.html"
    done = ringlight("report", run, page)
    assert done.code == 0, done.err
    assert "Traceback" not in done.err
    shown = read(page)
    if not file.startswith("checkpoint"):
        assert str(run / file) in done.err
        assert str(run / file) in shown.text


def test_a_damaged_picture_is_said(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = copy(trained["3dgs"], tmp_path / "run")
    picture = sorted((run / RENDERS).iterdir())[0]
    picture.write_bytes(b"no picture")
    page = tmp_path / "out.html"
    done = ringlight("report", run, page, "--no-layers")
    assert done.code == 0
    assert str(picture) in done.err
    views = len(json.loads((run / "report.json").read_text())["images"])
    assert len(read(page).all("article")) == min(views, 6) - 1
    shutil.rmtree(run / "images")
    done = ringlight("report", run, page, "--no-layers", "--overwrite")
    assert done.code == 0
    assert "has no pictures of its test views" in done.err


def test_runs_of_different_scenes_and_views_stand_apart(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    other = write_tiny_scene(tmp_path / "others", size=16)
    assert run_command(["train", str(other), "3dgs", "--out", str(tmp_path / "other"), *QUICK]) == 0
    smaller = copy(tmp_path / "other", tmp_path / "smaller")
    edit_json(smaller / "report.json", lambda report: report.update(scene="balls"))
    page = tmp_path / "out.html"
    done = ringlight("report", trained["3dgs"], tmp_path / "other", smaller, page)
    assert done.code == 0, done.err
    assert "differ in the" in done.err
    shown = read(page)
    assert [a.get("id") for a in shown.all("h2")] == ["s0", "s1", "s2", "runs"]
    assert "Apart from the others of this scene" in shown.text
    tables = [a for a in shown.all("table") if a.get("class") == "results"]
    assert len(tables) == 3, "no best and no ratio goes across runs that do not compare"


def test_mistakes_are_one_sentence(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run, page = trained["3dgs"], tmp_path / "out.html"
    refused(ringlight("report"), 2, ".html")
    refused(ringlight("report", run), 2, ".html")
    refused(ringlight("report", page), 2, "no runs")
    refused(ringlight("report", run, page, "--views", "-1"), 1, "--views is -1")
    refused(ringlight("report", run, page, "--views", "1001"), 1, "--views is 1001")
    refused(ringlight("report", tmp_path / "gone", page), 1, tmp_path / "gone")
    refused(ringlight("report", run.parent, page), 1, run.parent, run)
    refused(ringlight("report", run, tmp_path / "none" / "out.html"), 1, "does not exist")
    assert not page.exists()
    page.write_text("mine")
    refused(ringlight("report", run, page), 1, "--overwrite")
    assert page.read_text() == "mine"


def test_a_run_that_is_named_twice_counts_once(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    page, run = tmp_path / "out.html", trained["3dgs"]
    done = ringlight("report", run, run / ".." / run.name, page, "--no-layers", "--json")
    assert [one["label"] for one in json.loads(done.out)["runs"]] == ["3dgs"]
    assert json.loads(done.out)["bytes"] == page.stat().st_size


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", 1e308, -1e308, 0.0])
def test_numbers_that_no_chart_holds_do_no_harm(
    number: object, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = copy(trained["3dgs"], tmp_path / "run")

    def spoil(report: dict) -> None:
        for point in report["curve"][::2]:
            point.update(psnr=number, seconds=number, loss=number)
        for image in report["images"]:
            image.update(psnr=number)
        report.update(psnr=number, fps=number, train_seconds=number)

    edit_json(run / "report.json", spoil)
    done = ringlight("report", run, trained["ringlight-basis"], tmp_path / "out.html", "--no-layers")
    assert done.code == 0, done.err
    shown = read(tmp_path / "out.html")
    for path in shown.all("path"):
        assert not {"n", "i"} & set(path["d"] or ""), "neither nan nor inf"


def test_a_count_that_is_none_is_a_damaged_report(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = copy(trained["3dgs"], tmp_path / "run")
    edit_json(run / "report.json", lambda report: report.update(counted=10**400))
    done = ringlight("report", run, tmp_path / "out.html", "--no-layers")
    assert done.code == 0
    assert "counted is not of type int" in done.err
