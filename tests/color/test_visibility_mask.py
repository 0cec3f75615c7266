import torch

from ringlight.color.visibility_mask import straight_through_mask, straight_through_twin


def test_value_is_a_step_and_gradient_a_sigmoids():
    logits = torch.tensor([-8.0, -4.6, -4.59, 0.3, 20.0], requires_grad=True)
    factor = straight_through_mask(logits, 0.01)
    assert factor[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
    upstream = torch.tensor([[1.0], [2.0], [-1.0], [0.5], [3.0]])
    factor.backward(upstream)
    soft = logits.detach().sigmoid()
    torch.testing.assert_close(logits.grad, upstream[:, 0] * soft * (1 - soft))


def test_kernel_equals_twin():
    logits = torch.linspace(-9, 9, 1003)
    upstream = torch.randn(1003, 1, generator=torch.Generator().manual_seed(0))
    results = []
    for values, function in ((logits, straight_through_mask), (logits.double(), straight_through_twin)):
        leaf = values.clone().requires_grad_()
        factor = function(leaf, 0.05)
        factor.backward(upstream.to(values))
        results.append((factor.detach().double(), leaf.grad.double()))
    assert torch.equal(results[0][0], results[1][0])
    torch.testing.assert_close(results[0][1], results[1][1], rtol=1e-5, atol=5e-7)
