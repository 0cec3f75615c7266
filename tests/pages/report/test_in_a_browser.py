"""What the page's script does, seen by Chromium: values under the pointer, curtains, another run left of the line."""

import shutil
import subprocess
from importlib import resources
from pathlib import Path

import pytest
import torch
from parsed import Parsed
from PIL import Image
from samples import picture, sample_report

from ringlight.measure.json_record import to_json
from ringlight.measure.picture_names import RENDERS, TRUTHS, picture_name
from ringlight.measure.report import CurvePoint, ImageScore
from ringlight.pages.report import build
from ringlight.pages.report.build import write_report_page

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")

PROBE = """
addEventListener("load", () => {
  const found = document.documentElement.dataset;
  const chart = document.querySelector(".chart"), box = chart.getBoundingClientRect();
  const middle = { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2, bubbles: true };
  chart.dispatchEvent(new PointerEvent("pointermove", middle));
  const tip = document.querySelector(".tip");
  found.tip = tip.hidden ? "hidden" : tip.textContent;
  found.dots = chart.querySelectorAll("circle").length;
  chart.dispatchEvent(new PointerEvent("pointerleave"));
  found.after = tip.hidden + " " + chart.querySelectorAll("circle").length;
  const view = document.querySelector(".view"), inputs = view.querySelectorAll("input");
  inputs[0].value = 25;
  inputs[0].dispatchEvent(new Event("input"));
  found.cut = view.style.getPropertyValue("--cut") + " " + inputs[1].value;
  found.covered = getComputedStyle(view.querySelector(".over")).clipPath;
  const select = document.querySelector("select");
  select.value = "1";
  select.dispatchEvent(new Event("change"));
  const over = [...view.querySelectorAll(".over")], key = view.dataset.key;
  found.left = over.every((one) => one.src === document.getElementById(key + "-1").src);
  found.broken = [...document.images].filter((image) => !image.naturalWidth).length;
});
"""


def save(path: Path, pixels: torch.Tensor) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((pixels * 255).round().byte().numpy()).save(path)


def make_run(folder: Path, seed: int) -> Path:
    curve = tuple(CurvePoint(10 * i, i / 5, 20.0 + i + seed, 100 * i, 1 / i) for i in range(1, 11))
    images = tuple(ImageScore(name, 20.0 + seed, 20.0, 0.8, 0.8) for name in ("a", "b"))
    for name in ("a", "b"):
        save(folder / RENDERS / picture_name(name), picture(seed=seed + 1))
        save(folder / TRUTHS / picture_name(name), picture(seed=9))
    report = sample_report(preset=f"method {seed}", curve=curve, images=images)
    (folder / "report.json").write_text(to_json(report))
    return folder


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
def test_the_script_works_from_a_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = tmp_path / "probed_page"
    sources.mkdir()
    for file in resources.files(build.SOURCES).iterdir():
        if file.name.startswith("page."):
            (sources / file.name).write_text(file.read_text() + (PROBE if file.name == "page.js" else ""))
    (sources / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(build, "SOURCES", "probed_page")
    page = tmp_path / "page.html"
    write_report_page([make_run(tmp_path / f"run{seed}", seed) for seed in (0, 1)], page, with_layers=False)
    words = [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    done = subprocess.run([*words, profile, page.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    assert "CONSOLE" not in done.stderr, "no error, and nothing that the policy forbids"
    found = Parsed(done.stdout).all("html")[0]
    assert found["data-tip"] == "40 stepsmethod 024method 125", "left of the middle, where the numbers on the axis are"
    assert found["data-dots"] == "2"
    assert found["data-after"] == "true 0"
    assert found["data-cut"] == "25% 25"
    assert "75%" in (found["data-covered"] or "")
    assert found["data-left"] == "true"
    assert found["data-broken"] == "0"
