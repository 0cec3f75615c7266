"""train --verify: says that a run repeats itself, and notices when it does not."""

from pathlib import Path

import pytest
import torch
from cli_session import QUICK, SMALL_LIGHT
from command import Command
from refusal import refused

from ringlight.fit.optimizer import Optimizer


@pytest.mark.parametrize(("method", "flags"), [("3dgs", ()), ("ringlight-ring", SMALL_LIGHT)])
def test_every_trial_has_the_same_bits(
    method: str, flags: tuple[str, ...], tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    told = ringlight("train", tiny, method, *QUICK, *flags, "--verify", 24)
    assert told.code == 0, told.err
    lines = [line.split("  ") for line in told.out.splitlines()]
    assert len(lines) == 4
    assert len({digest for digest, _, _ in lines}) == 1
    assert {verdict for _, verdict, _ in lines} == {"the same bits"}
    assert list(tmp_path.iterdir()) == [], "nothing is written"


def test_a_run_that_depends_on_something_else_is_found_out(
    tiny: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = Optimizer.step

    def disturbed(optimizer: Optimizer, number: int, *others: object) -> None:
        step(optimizer, number, *others)
        if number == 6:
            optimizer.model.columns["means"].data[0, 0] += torch.rand(())  # torch's own generator: goes on and on

    monkeypatch.setattr(Optimizer, "step", disturbed)
    told = ringlight("train", tiny, "3dgs", *QUICK, "--verify", 8)
    assert told.code == 1
    assert told.out.count("OTHER BITS") == 3
    assert "the first loss that differs is that of step 7" in told.out
    assert "model.columns.means" in told.out


@pytest.mark.parametrize("steps", [1, 41])
def test_a_number_of_steps_that_cannot_be_compared(steps: int, tiny: Path, ringlight: Command) -> None:
    refused(ringlight("train", tiny, "3dgs", *QUICK, "--verify", steps), 1, "--verify", "2 to 40")
