"""``ringlight train --horizon``: every photograph gets a horizon, and the model file the same bytes."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_session import QUICK
from command import Command

from ringlight.fit.train import Progress
from ringlight.runs.session import Session


def test_a_horizon_for_every_photograph_changes_no_bit_of_the_model(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, photographs = Session.steps, set()

    def watched(session: Session) -> Iterator[Progress]:
        for progress in steps(session):
            photographs.update(session.training.horizons)
            yield progress

    with monkeypatch.context() as patched:
        patched.setattr(Session, "steps", watched)
        assert ringlight("train", tiny, "3dgs", "--out", tmp_path / "run", *QUICK, "--horizon").code == 0
    assert len(photographs) > 1
    model = "model.safetensors"
    assert (tmp_path / "run" / model).read_bytes() == (trained["3dgs"] / model).read_bytes()
