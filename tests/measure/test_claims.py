"""The paper's claims: its numbers as comparisons, and one rule that judges them by records."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ringlight.errors import OutputError, RunError
from ringlight.measure.claim_page import BEGIN, END, all_judged, claim_section, filled
from ringlight.measure.claim_records import Record, Subject, joined, records_in
from ringlight.measure.claims import Claim, claims_of, paper_claims
from ringlight.measure.verdicts import LEAST_STEPS, NOISE, RATIOS, judged
from ringlight.methods.studies import PAPER_FEATURES, PAPER_RANKS, study_named
from ringlight.methods.table import METHODS

PAPER = paper_claims()
SHINY = "Shiny-Blender"


def claim_beside(where: str, other: str, data_set: str = SHINY) -> Claim:
    table = next(table for table in PAPER.tables if table.where == where)
    return next(c for c in claims_of(table) if c.other.name == other and c.data_set == data_set)


def record(name: str, psnr: float, *, study: str | None = None, scene: str = "toaster_400", **more: Any) -> Record:
    values = {"psnr": psnr, "ssim": 0.9, "lpips_alex": 0.1, "megabytes": 10.0} | more.pop("values", {})
    kind, steps, seeds = more.pop("kind", "train"), more.pop("steps", 30_000), more.pop("seeds", (0,))
    machine = more.pop("machine", "one")
    return Record(kind, f"{kind}-{name}.json", scene, steps, Subject(study, name), seeds, values, machine)


def test_the_record_is_that_of_the_studies_and_of_methods_that_there_are():
    for table in PAPER.tables:
        names = {row.subject for row in table.rows}
        if table.study is None:
            assert names - METHODS.keys() <= {"tensorf", "putt", "3igs", "gaussian-shader"}, "or they are on their way"
        else:
            assert names <= {variant.name for variant in study_named(table.study, None, None)}
    ranks = {int(row.name.split()[-1]): row.values[SHINY]["psnr"] for row in PAPER.tables[4].rows}
    features = {int(row.name.split()[0]): row.values[SHINY]["psnr"] for row in PAPER.tables[5].rows}
    assert (ranks, features) == (PAPER_RANKS, PAPER_FEATURES)


def test_every_row_is_held_against_the_methods_own():
    found = [claim for table in PAPER.tables for claim in claims_of(table)]
    assert len(found) == 3 * 8 * 3 + 4 + 3 + 3
    assert all(claim.own is not claim.other and claim.values for claim in found)
    beside = claim_beside("table 1", "3DGS")
    assert beside.values["psnr"] == (29.01, 28.87)
    assert beside.values["megabytes"] == (15.95, 46.43)


@given(ours=st.floats(-3, 3))
def test_half_of_the_difference_reproduces_it_or_as_near_as_seeds_are(ours: float):
    claim = claim_beside("tables 2 and 3", "w/o neural module")  # 1.28 dB
    records = [record("full", 30.0 + ours, study="ablation"), record("discrete", 30.0, study="ablation")]
    found = judged(claim, PAPER, records).verdicts["psnr"]
    assert found.ours == pytest.approx(ours, abs=1e-9)
    assert found.paper == pytest.approx(1.28)
    if abs(ours - 0.64) > 1e-6:
        assert found.word == ("reproduced" if ours > 0.64 else "not reproduced")


def test_a_difference_as_small_as_that_of_seeds_is_reproduced_by_none():
    claim = claim_beside("tables 2 and 3", "w/o light modulation")  # 0.07 dB
    for ours, word in ((0.0, "reproduced"), (-0.02, "reproduced"), (-0.2, "not reproduced"), (1.0, "reproduced")):
        records = [record("full", 30.0 + ours, study="ablation"), record("no-modulation", 30.0, study="ablation")]
        assert judged(claim, PAPER, records).verdicts["psnr"].word == word, ours


@pytest.mark.parametrize(
    ("megabytes", "word"),
    [(10.0, "not reproduced"), (13.1, "reproduced"), (17.1, "reproduced"), (17.3, "not reproduced")],
)
def test_where_the_paper_is_behind_ours_is_not_far_more_so(megabytes: float, word: str):
    claim = claim_beside("table 1", "LightGaussian", "Tanks and Temples")  # 1.31 times the bytes
    records = [
        record("ringlight-paper", 30.0, scene="family_24", values={"megabytes": megabytes}),
        record("light-gaussian", 30.0, scene="family_24", values={"megabytes": 10.0}),
    ]
    assert judged(claim, PAPER, records).verdicts["megabytes"].word == word


def test_times_are_held_against_each_other_on_one_machine_alone():
    claim = claim_beside("table 4", "3DGS")
    own = record("ringlight-paper", 30.0, values={"fps": 77.0})
    for machine, word in (("one", "reproduced"), ("another", "cannot be tested"), (None, "cannot be tested")):
        other = record("3dgs", 30.0, values={"fps": 100.0}, machine=machine)
        assert judged(claim, PAPER, [own, other]).verdicts["fps"].word == word
    unknown = [record(name, 30.0, values={"fps": 90.0}, machine=None) for name in ("ringlight-paper", "3dgs")]
    assert judged(claim, PAPER, unknown).verdicts["fps"].word == "cannot be tested"


def test_sizes_are_ratios_and_scenes_a_mean():
    claim = claim_beside("table 1", "3DGS")
    records = [
        record("ringlight-paper", 30.0, values={"megabytes": 4.0}),
        record("3dgs", 30.0, values={"megabytes": 8.0}),
        record("ringlight-paper", 31.0, scene="carpaint_200", values={"megabytes": 1.0}),
        record("3dgs", 30.0, scene="carpaint_200", values={"megabytes": 8.0}),
    ]
    found = judged(claim, PAPER, records)
    assert found.verdicts["psnr"].ours == pytest.approx(0.5)
    assert found.verdicts["megabytes"].ours == pytest.approx(math.exp((math.log(0.5) + math.log(0.125)) / 2))
    assert found.verdicts["megabytes"].paper == pytest.approx(15.95 / 46.43)
    assert "toaster_400" in found.because
    assert "carpaint_200" in found.because


def test_distances_of_two_networks_are_not_held_against_each_other():
    claim = claim_beside("table 1", "3DGS")
    own, other = record("ringlight-paper", 31.0), record("3dgs", 30.0)
    assert judged(claim, PAPER, [own, other]).verdicts["lpips"].ours == 0
    by_both = replace(own, values=own.values | {"lpips_vgg": 0.2})
    assert judged(claim, PAPER, [by_both, other]).verdicts["lpips"].ours == 0, "the other has none by VGG"
    by_vgg = replace(own, values={"psnr": 31.0, "lpips_vgg": 0.2})
    assert judged(claim, PAPER, [by_vgg, other]).verdicts["lpips"].word == "cannot be tested"
    carpaint = [replace(one, scene="carpaint_200") for one in (own, other)]
    vgg_on_one = [replace(one, values=one.values | {"lpips_vgg": vgg}) for one, vgg in ((own, 0.2), (other, 0.3))]
    assert judged(claim, PAPER, [*vgg_on_one, *carpaint]).verdicts["lpips"].ours == 0, "by AlexNet on both scenes"
    assert judged(claim, PAPER, vgg_on_one).verdicts["lpips"].ours == pytest.approx(-0.1)


def test_only_records_that_compare_are_held_against_each_other():
    claim = claim_beside("table 1", "3DGS")
    own = record("ringlight-paper", 31.0)
    others = {
        "another length": record("3dgs", 30.0, steps=7_000),
        "another seed": record("3dgs", 30.0, seeds=(1,)),
        "another kind": record("3dgs", 30.0, kind="readme"),
        "another scene": record("3dgs", 30.0, scene="balls_400"),
        "a study's": record("3dgs", 30.0, study="ablation"),
    }
    for what, other in others.items():
        found = judged(claim, PAPER, [own, other])
        assert {verdict.word for verdict in found.verdicts.values()} == {"cannot be tested"}, what
        assert "no record" in found.because
    assert judged(claim, PAPER, [own, record("3dgs", 30.0)]).verdicts["psnr"].word == "reproduced"


def test_short_runs_decide_nothing_and_the_longest_count():
    claim = claim_beside("table 1", "3DGS")
    short = [record(name, psnr, steps=LEAST_STEPS - 1) for name, psnr in (("ringlight-paper", 35.0), ("3dgs", 30.0))]
    found = judged(claim, PAPER, short)
    assert found.verdicts["psnr"].word == "cannot be tested"
    assert found.verdicts["psnr"].ours == pytest.approx(5.0), "shown all the same"
    assert found.because.startswith("too short to decide: toaster_400, 6,999 steps")
    long = [record("ringlight-paper", 29.0), record("3dgs", 30.0)]
    assert judged(claim, PAPER, short + long).verdicts["psnr"].ours == pytest.approx(-1.0)


def written(folder: Path) -> Path:
    run = {"psnr": 30.0, "preset": "3dgs", "ssim_same": 0.9, "bytes_raw": 8_000_000, "iterations": 7000, "seed": 1,
           "scene": "chair_400", "lpips_alex": 0.1, "fps": 20.0, "train_cpu_seconds": 120.0}  # fmt: skip
    cell = {"mean": 31.0, "deviation": None, "rank": 1}
    table = {
        "measures": {"psnr": {"scenes": {"lego_400": {"3dgs": cell, "light-gaussian": None}}},
                     "core_seconds": {"scenes": {"lego_400": {"3dgs": cell}}}},
        "runs": [{"scene": "lego_400", "method": m, "seed": 0, "steps": 7000} for m in ("3dgs", "light-gaussian")],
    }  # fmt: skip
    spread = {"mean": 21.0, "deviation": None}
    row = {"scene": "carpaint", "variant": "full", "seeds": 2, "psnr": spread, "ssim": spread, "raw_megabytes": spread}
    study = {"study": "rank", "steps": 3000, "rows": [row]}
    for name, data in (("train-a", run), ("table-b", table), ("study-c", study), ("train-d", {"other": 1})):
        (folder / f"{name}.json").write_text(json.dumps(data))
    return folder


def test_runs_tables_and_studies_are_read(tmp_path: Path):
    found = {r.file: r for r in records_in(written(tmp_path))}
    assert found.keys() == {"train-a.json", "table-b.json", "study-c.json"}
    assert found["train-a.json"].values["minutes"] == 2.0
    assert found["train-a.json"].values["lpips_alex"] == 0.1
    assert found["table-b.json"].values == {"psnr": 31.0, "minutes": pytest.approx(31 / 60)}
    assert found["study-c.json"].subject == Subject("rank", "full")
    assert found["study-c.json"].seeds == (0, 1)


def test_runs_of_readme_with_other_settings_are_left_out(tmp_path: Path):
    run = json.loads((written(tmp_path) / "train-a.json").read_text())
    run["machine"] = {"cpu": "A", "threads": 1, "isa": "avx2", "gpu": None, "memory": 5}
    for name in ("", "-seed1", "-from-hull", "-seed1-slow"):
        (tmp_path / f"readme-chair_400-7000-3dgs{name}.json").write_text(json.dumps(run))
    (tmp_path / "readme-toaster-bundled-7000-3dgs.json").write_text(json.dumps(run | {"scene": "toaster"}))
    *found, bundled = [r for r in records_in(tmp_path) if r.kind == "readme"]
    assert bundled.scene == "toaster"
    assert [r.file for r in found] == ["readme-chair_400-7000-3dgs-seed1.json", "readme-chair_400-7000-3dgs.json"]
    assert found[0].machine == found[1].machine is not None
    assert joined(found).machine == found[0].machine
    assert joined([found[0], replace(found[1], machine="B")]).machine is None


def test_what_is_no_record_is_a_sentence(tmp_path: Path):
    with pytest.raises(RunError, match="--results"):
        records_in(tmp_path / "nowhere")
    (tmp_path / "train-x.json").write_text("{")
    with pytest.raises(RunError, match="train-x"):
        records_in(tmp_path)
    (tmp_path / "train-x.json").write_text(json.dumps({"psnr": "high", "preset": "3dgs"}))
    with pytest.raises(RunError, match="no 'scene'"):
        records_in(tmp_path)


def test_the_section_fills_its_place_and_leaves_all_else(tmp_path: Path):
    section = claim_section(PAPER, all_judged(PAPER, records_in(written(tmp_path))), "ringlight reproduce")
    assert section.startswith(BEGIN)
    assert section.endswith(END + "\n")
    page = filled("# Mine\n\nMy words.\n", section, "page")
    assert page == "# Mine\n\nMy words.\n\n" + section
    assert filled(page + "\nAfter.\n", section, "page") == page + "\nAfter.\n"
    with pytest.raises(OutputError, match="one of the two marks"):
        filled(page.replace(END, ""), section, "page")


def test_what_changes_by_chance_is_known_of_every_measure():
    measures = {name for table in PAPER.tables for row in table.rows for of in row.values.values() for name in of}
    assert measures == NOISE.keys()
    assert set(RATIOS) <= measures
