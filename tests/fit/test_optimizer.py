"""Adam is torch's Adam; moments follow rows; a parameter without a rate is refused; state round-trips."""

import pytest
import torch
from torch import nn

from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Footprint
from ringlight.errors import RecipeError
from ringlight.fit.optimizer import Directed, Optimizer
from ringlight.fit.rates import Adam, Rate

GROUP = Adam(Rate.constant(0.01))


class Table(nn.Module):
    """Columns as a splat model has them, and one shared weight."""

    def __init__(self, rows: int = 5):
        super().__init__()
        draw = torch.Generator().manual_seed(0)
        table = Gaussians(*(torch.randn(rows, *size, generator=draw) for size in ((3,), (3,), (4,), ())))
        self.columns = nn.ParameterDict({name: nn.Parameter(t) for name, t in table.columns().items()})
        self.shared = nn.Linear(2, 2)


def stepped(model: Table, optimizer: Optimizer, step: int, footprint: Footprint | None = None) -> None:
    draw = torch.Generator().manual_seed(step)
    found = {name: torch.randn(parameter.shape, generator=draw) for name, parameter in model.named_parameters()}
    optimizer.step(step, Gradients(found), footprint)


def footprint_of(drawn: torch.Tensor) -> Footprint:
    radii = torch.where(drawn[:, None], 3.0, 0.0).repeat(1, 2)
    return Footprint(torch.zeros_like(radii), radii)


def test_moments_follow_rows_and_new_rows_start_at_zero():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    stepped(model, optimizer, 1)
    before, columns = optimizer.state(), {name: p.detach().clone() for name, p in model.columns.items()}
    added = Gaussians.from_columns({name: p[:2] for name, p in columns.items()})
    count = len(columns["means"])
    optimizer.edit_rows(torch.tensor([3, count + 1, 0, count]), added)
    after = optimizer.state()
    for name in columns:
        assert torch.equal(model.columns[name], columns[name][[3, 1, 0, 0]])
        for moment in ("mean", "square"):
            found = after[f"{moment}.columns.{name}"]
            assert torch.equal(found[[0, 2]], before[f"{moment}.columns.{name}"][[3, 0]])
            assert not found[[1, 3]].any()


def test_a_row_steps_the_same_whether_or_not_others_were_removed():
    edited, whole = Table(), Table()
    whole.load_state_dict(edited.state_dict())
    optimizers = [Optimizer(model, {"*": GROUP}, steps=10) for model in (edited, whole)]
    for step in (1, 2):
        for model, optimizer in zip((edited, whole), optimizers, strict=True):
            stepped(model, optimizer, step)
    optimizers[0].edit_rows(torch.tensor([4, 2]))
    gradients = {
        name: torch.randn(p.shape, generator=torch.Generator().manual_seed(9)) for name, p in whole.columns.items()
    }
    for optimizer, rows in zip(optimizers, ([4, 2], slice(None)), strict=True):
        optimizer.step(3, Gradients({f"columns.{name}": gradient[rows] for name, gradient in gradients.items()}))
    assert all(torch.equal(edited.columns[name], whole.columns[name][[4, 2]]) for name in gradients)


def test_rows_that_were_not_drawn_wait_if_wished():
    waiting, dense = Table(), Table()
    dense.load_state_dict(waiting.state_dict())
    optimizers = [Optimizer(m, {"*": GROUP}, steps=10, visible_only=m is waiting) for m in (waiting, dense)]
    drawn = torch.tensor([True, False, True, True, False])
    for model, optimizer in zip((waiting, dense), optimizers, strict=True):
        stepped(model, optimizer, 1, footprint_of(torch.ones(5, dtype=torch.bool)))
        before = {name: parameter.detach().clone() for name, parameter in model.named_parameters()}
        ones = Gradients({name: torch.ones_like(parameter) for name, parameter in model.named_parameters()})
        optimizer.step(2, ones, footprint_of(drawn))
    for name, column in waiting.columns.items():
        assert torch.equal(column[drawn], dense.columns[name][drawn])
        assert torch.equal(column[~drawn], before[f"columns.{name}"][~drawn])
        assert not torch.equal(dense.columns[name][~drawn], before[f"columns.{name}"][~drawn])
    assert torch.equal(waiting.shared.weight, dense.shared.weight)


def test_rows_that_were_drawn_must_be_known_if_others_shall_wait():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10, visible_only=True)
    before = {name: parameter.detach().clone() for name, parameter in model.named_parameters()}
    with pytest.raises(RecipeError, match="switch visible_only off"):
        stepped(model, optimizer, 1)
    assert all(torch.equal(parameter, before[name]) for name, parameter in model.named_parameters())


def test_a_part_of_the_model_that_was_exchanged_is_what_moves():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    old, model.shared = model.shared, nn.Linear(2, 2)
    weights = [module.weight.detach().clone() for module in (old, model.shared)]
    stepped(model, optimizer, 1)
    assert torch.equal(old.weight, weights[0])
    assert not torch.equal(model.shared.weight, weights[1])
    del model.shared
    with pytest.raises(KeyError, match="shared"):
        stepped(model, optimizer, 2)


def test_replace_clears_the_moments():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    stepped(model, optimizer, 1)
    optimizer.replace("columns.opacity_logits", torch.full((5,), -4.0))
    optimizer.replace("shared.weight", torch.eye(2))
    assert torch.equal(model.columns["opacity_logits"], torch.full((5,), -4.0))
    assert torch.equal(model.shared.weight, torch.eye(2))
    assert not optimizer.state()["mean.columns.opacity_logits"].any()
    assert not optimizer.state()["square.shared.weight"].any()


def test_a_parameter_that_no_rate_matches_is_refused_by_name():
    with pytest.raises(RecipeError, match=r"shared\.weight"):
        Optimizer(Table(), {"columns.*": GROUP}, steps=10)


def test_a_parameter_without_gradient_is_left_alone():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    before, means = model.shared.weight.detach().clone(), model.columns["means"].detach().clone()
    optimizer.step(1, Gradients({"columns.means": torch.ones(5, 3)}))
    assert not torch.equal(model.columns["means"], means)
    assert torch.equal(model.shared.weight, before)


def test_restored_state_goes_on_bitwise():
    model, other = Table(), Table()
    optimizer, resumed = (Optimizer(m, {"*": Adam(Rate(0.1, 0.001))}, steps=9) for m in (model, other))
    for step in (1, 2, 3):
        stepped(model, optimizer, step)
    other.load_state_dict(model.state_dict())
    resumed.restore(optimizer.state())
    for m, o in ((model, optimizer), (other, resumed)):
        stepped(m, o, 4)
    assert all(torch.equal(a, b) for a, b in zip(model.parameters(), other.parameters(), strict=True))


def test_in_added_steps_rates_run_their_course_once_more():
    model = Table()
    optimizer = Optimizer(model, {"*": Adam(Rate(1e-1, 1e-3), begins=20)}, steps=100)
    before = [optimizer._progress(step, 20) for step in range(1, 101)]
    optimizer.extend(40)
    optimizer.extend(10)
    assert [optimizer._progress(step, 20) for step in range(1, 101)] == before
    assert before[-1] == 1
    for first, last in ((100, 140), (140, 150)):
        shares = [optimizer._progress(step, 20) for step in range(first + 1, last + 1)]
        assert shares == sorted(shares)
        assert 0 < shares[0] <= 0.1
        assert shares[-1] == 1


def test_a_scaled_parameter_goes_as_one_in_other_bases_would():
    """p = S q with S its own transpose: a gradient g of p is S g of q, which torch's Adam steps."""
    model = Table()
    scale = torch.tensor([[2.0, 0.5], [0.5, 1.0]])
    inner = torch.linalg.solve(scale, model.shared.weight.detach().T).T.contiguous().requires_grad_()
    judge = torch.optim.Adam([inner], lr=0.01, eps=1e-15)
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    optimizer.scale({"shared.weight": lambda rows: rows @ scale})
    before = model.shared.bias.detach().clone()
    for step in (1, 2, 3):
        draw = torch.Generator().manual_seed(step)
        gradient = torch.randn(2, 2, generator=draw)
        optimizer.step(step, Gradients({"shared.weight": gradient}))
        inner.grad = gradient @ scale
        judge.step()
    torch.testing.assert_close(model.shared.weight.detach(), inner.detach() @ scale)
    assert torch.equal(model.shared.bias, before)
    assert optimizer.scales
    optimizer.begin_anew()
    assert not optimizer.scales


def direction_of(mean: torch.Tensor) -> torch.Tensor:
    """Of one size."""
    return mean / mean.norm()


def test_a_directed_parameter_goes_along_what_is_made_of_its_mean_in_other_bases():
    model = Table()
    scale = torch.tensor([[2.0, 0.5], [0.5, 1.0]])
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    directed = Directed({"shared.weight": direction_of}, 0.8)
    optimizer.scale({"shared.weight": lambda rows: rows @ scale}, directed)
    expected, mean, bias = model.shared.weight.detach().clone(), torch.zeros(2, 2), model.shared.bias.detach().clone()
    for step in (1, 2, 3):
        gradient = torch.randn(2, 2, generator=torch.Generator().manual_seed(step))
        assert optimizer.step(step, Gradients({"shared.weight": gradient})) is None
        mean = mean.lerp(gradient @ scale, 0.2)
        expected -= 0.01 * direction_of(mean) @ scale
    torch.testing.assert_close(model.shared.weight.detach(), expected)
    torch.testing.assert_close(optimizer.state()["mean.shared.weight"], mean)
    torch.testing.assert_close(optimizer.means(["shared.weight"])["shared.weight"], mean)
    assert torch.equal(model.shared.bias, bias)


def test_what_decays_goes_as_torchs_own_does_and_nothing_else_decays():
    model = Table()
    falling = Rate(0.02, 0.01)
    groups = {"shared.weight": Adam(falling, decay=0.3), "shared.*": Adam(falling), "*": GROUP}
    optimizer = Optimizer(model, groups, steps=4)
    inner = [nn.Parameter(part.detach().clone()) for part in (model.shared.weight, model.shared.bias)]
    weights = [{"params": [part], "weight_decay": decay} for part, decay in zip(inner, (0.3, 0.0), strict=True)]
    judge = torch.optim.AdamW(weights, eps=1e-15)
    for step in (1, 2, 3):
        drawn = torch.Generator().manual_seed(step)
        for group in judge.param_groups:
            group["lr"] = falling.at(step / 4)
        for part in inner:
            part.grad = torch.randn(part.shape, generator=drawn)
        judge.step()
        weight, bias = (part.grad for part in inner)
        optimizer.step(step, Gradients({"shared.weight": weight, "shared.bias": bias}))
    torch.testing.assert_close(model.shared.weight, inner[0])
    torch.testing.assert_close(model.shared.bias, inner[1])


def test_a_directed_parameter_decays_as_others_do():
    model = Table()
    optimizer = Optimizer(model, {"columns.*": GROUP, "*": Adam(Rate.constant(0.01), decay=0.5)}, steps=10)
    scale = torch.tensor([[2.0, 0.5], [0.5, 1.0]])
    optimizer.scale({"shared.weight": lambda rows: rows @ scale}, Directed({"shared.weight": direction_of}, 0.0))
    before, gradient = model.shared.weight.detach().clone(), torch.tensor([[1.0, -2.0], [0.5, 3.0]])
    optimizer.step(1, Gradients({"shared.weight": gradient}))
    expected = (1 - 0.01 * 0.5) * before - 0.01 * direction_of(gradient @ scale) @ scale
    torch.testing.assert_close(model.shared.weight.detach(), expected)


@pytest.mark.parametrize("directed", [False, True])
def test_what_a_fault_leaves_as_it_was_does_not_decay(directed: bool):
    model = Table()
    optimizer = Optimizer(model, {"columns.*": GROUP, "*": Adam(Rate.constant(0.01), decay=10.0)}, steps=10)
    if directed:
        optimizer.scale({"shared.weight": torch.clone}, Directed({"shared.weight": direction_of}, 0.8))
    before = model.shared.weight.detach().clone()
    assert optimizer.step(1, Gradients({"shared.weight": torch.full((2, 2), float("nan"))})) is not None
    assert torch.equal(model.shared.weight, before)


def test_columns_cannot_decay():
    with pytest.raises(RecipeError, match=r"^columns\.\w+ shall decay, and columns of a table cannot"):
        Optimizer(Table(), {"*": Adam(Rate.constant(0.01), decay=0.1)}, steps=10)


@pytest.mark.parametrize(
    ("bad", "words"),
    [(float("nan"), "shared.weight"), (float("inf"), "shared.weight"), (1e25, "too large to be squared")],
)
def test_a_directed_parameter_stays_where_any_of_its_gradient_cannot_be_squared(bad: float, words: str):
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    directed = Directed({"shared.weight": direction_of, "shared.bias": direction_of}, 0.8)
    optimizer.scale({"shared.weight": torch.clone, "shared.bias": torch.clone}, directed)
    before = model.shared.weight.detach().clone(), model.shared.bias.detach().clone()
    weight = torch.ones(2, 2)
    weight[1, 0] = bad
    fault = optimizer.step(1, Gradients({"shared.weight": weight, "shared.bias": torch.ones(2)}))
    assert fault is not None
    assert words in fault
    assert torch.equal(model.shared.weight, before[0])
    assert not torch.equal(model.shared.bias, before[1])
    assert not optimizer.state()["mean.shared.weight"].any()


def test_moments_are_forgotten_where_training_begins_anew():
    model = Table()
    optimizer = Optimizer(model, {"*": GROUP}, steps=10)
    stepped(model, optimizer, 1)
    with torch.no_grad():
        model.columns["means"] = nn.Parameter(torch.zeros(9, 3))
    optimizer.begin_anew()
    state = optimizer.state()
    assert not any(tensor.any() for tensor in state.values())
    assert state["mean.columns.means"].shape == (9, 3)
