import torch

from ringlight.fields.networks import PerceptronStack, perceptron


def test_stack_equals_separate_perceptrons():
    stack = PerceptronStack(3, (5, 7, 7, 4), torch.Generator().manual_seed(0))
    values = torch.randn(3, 6, 5)
    together = stack(values)
    for head in range(3):
        alone = perceptron((5, 7, 7, 4), torch.Generator().manual_seed(1))
        for layer, weight, bias in zip(alone[::2], stack.weights, stack.biases, strict=True):
            layer.weight.data = weight[head].T.detach().clone()
            layer.bias.data = bias[head, 0].detach().clone()
        torch.testing.assert_close(together[head], alone(values[head]), rtol=1e-5, atol=1e-6)


def test_start_is_the_generators_and_within_torchs_bound():
    first = perceptron((64, 32, 1), torch.Generator().manual_seed(3))
    again = perceptron((64, 32, 1), torch.Generator().manual_seed(3))
    for one, other in zip(first.parameters(), again.parameters(), strict=True):
        assert torch.equal(one, other)
    assert first[0].weight.abs().max() <= 64**-0.5
    assert first[0].weight.std() > 0.5 * 64**-0.5
