"""Why a photograph got no camera, and what a person reads."""

from ringlight.measure.json_record import from_json, to_json
from ringlight.poses.database import Matches
from ringlight.poses.report import Failure, PosesReport, why_not

MODELS = [["a", "b", "c"], ["x", "y"]]


def reason(name: str, features: int = 500, matches: Matches | None = None) -> str:
    return why_not(name, {name: features}, {name: matches} if matches else {}, MODELS).reason


def test_each_reason():
    assert reason("x", matches=Matches(3, 60)) == "belongs to another model, of 2 photographs"
    assert "too little to recognise (12 features)" in reason("q", 12)
    assert reason("q") == "overlaps with no other photograph"
    assert "17 common points at most, with 1 photograph" in reason("q", matches=Matches(1, 17))
    assert "too little" in why_not("unheard of", {}, {}, []).reason


def report(**changes: object) -> PosesReport:
    usual = {
        "scene": "s", "photographs": 6, "registered": 3, "reprojection_error": 0.5, "points": 100,
        "track_length": 3.0, "models": (3, 2), "mapper": "global", "matching": "all", "pairs": 15, "lenses": ("L",),
        "up": "why", "picture": "s/cameras.png", "failed": (Failure("x", "because"),), "seconds": {"features": 1.0},
    }  # fmt: skip
    return PosesReport(**(usual | changes))  # type: ignore[arg-type]


def test_a_person_reads_the_numbers_the_models_and_the_failures():
    lines = "\n".join(report().lines())
    assert "3 of 6 photographs have cameras, mean reprojection error 0.50 pixels" in lines
    assert "fall into 2 models that share no points (3, 2 photographs)" in lines
    assert "  x: because" in lines
    assert "models" not in "\n".join(report(models=(6,)).lines())


def test_many_failures_are_counted_rather_than_named():
    lines = report(failed=tuple(Failure(f"n{i}", "r") for i in range(40))).lines()
    assert lines[-1] == "  and 28 more, in the report"


def test_it_survives_its_file():
    assert from_json(PosesReport, to_json(report()), "file") == report()
