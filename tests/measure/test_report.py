"""Reports: JSON and back without loss, strict about what is missing, generous about what is new."""

import json
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from samples import sample_report

from ringlight.errors import RunError
from ringlight.measure.json_record import from_json, to_json
from ringlight.measure.report import ImageScore, Report, read_report

NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
MAYBE = st.none() | NUMBERS
SCORES = st.builds(ImageScore, st.text(), NUMBERS, NUMBERS, NUMBERS, NUMBERS, MAYBE, MAYBE, MAYBE)


@given(
    psnr=NUMBERS,
    lpips=MAYBE,
    seed=st.none() | st.integers(-(2**63) + 1, 2**63 - 1),
    scene=st.text(),
    notes=st.lists(st.text()).map(tuple),
    parts=st.dictionaries(st.text(), st.integers(-(2**63) + 1, 2**63 - 1)),
    images=st.lists(SCORES, max_size=3).map(tuple),
)
def test_every_report_survives_the_round_trip(psnr, lpips, seed, scene, notes, parts, images):
    report = sample_report(
        psnr=psnr, lpips_vgg=lpips, seed=seed, scene=scene, notes=notes, bytes_by_part=parts, images=images
    )
    again = from_json(Report, to_json(report), "here.json")
    # repr, because NaN is not equal to itself.
    assert repr(again) == repr(report)


@given(NUMBERS)
def test_the_text_is_valid_json_whatever_was_measured(psnr):
    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    written = json.loads(to_json(sample_report(psnr=psnr)), parse_constant=refuse)["psnr"]
    assert isinstance(written, float) == math.isfinite(psnr)


def test_fields_of_newer_versions_are_skipped():
    data = json.loads(to_json(sample_report()))
    data["invented_later"] = {"a": [1]}
    data["images"][0]["another"] = 3
    data["machine"]["npu"] = "fast"
    assert from_json(Report, json.dumps(data), "here.json") == sample_report()


@pytest.mark.parametrize("field", ["psnr", "lpips_alex", "machine", "images", "bytes_by_part"])
def test_a_missing_field_is_named(field):
    data = json.loads(to_json(sample_report()))
    del data[field]
    with pytest.raises(RunError, match=f"here.json: '{field}' is missing .*ringlight eval"):
        from_json(Report, json.dumps(data), "here.json")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("psnr", "high"),
        ("counted", None),
        ("psnr", True),
        ("psnr", 10**400),
        ("counted", 1.5),
        ("counted", True),
        ("scene", 3),
        ("notes", "one"),
        ("images", {}),
        ("images", [1]),
        ("machine", []),
        ("bytes_by_part", {"means": "many"}),
    ],
)
def test_a_field_of_another_type_is_named(field, value):
    data = json.loads(to_json(sample_report())) | {field: value}
    with pytest.raises(RunError, match=f"here.json: {field}.* is not of type"):
        from_json(Report, json.dumps(data), "here.json")


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"psnr": NaN}', "[]", "null", '"report"'])
def test_what_is_no_report_is_refused_in_one_sentence(text):
    with pytest.raises(RunError, match="ringlight eval") as caught:
        from_json(Report, text, "here.json")
    assert "\n" not in str(caught.value)


def test_a_run_folder_is_read_or_its_fault_is_told(tmp_path):
    with pytest.raises(RunError, match="no such run folder"):
        read_report(tmp_path / "nowhere")
    with pytest.raises(RunError, match=r"holds no report\.json"):
        read_report(tmp_path)
    deep = tmp_path / "table" / "chair" / "3dgs" / "seed-0"
    deep.mkdir(parents=True)
    (deep / "report.json").write_text(to_json(sample_report()), encoding="utf-8")
    with pytest.raises(RunError, match=f"name the runs inside it: {re.escape(str(deep))}"):
        read_report(tmp_path / "table")
    (tmp_path / "report.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RunError, match="cannot be read"):
        read_report(tmp_path)
    (tmp_path / "report.json").write_text(to_json(sample_report()), encoding="utf-8")
    assert read_report(tmp_path) == sample_report()
