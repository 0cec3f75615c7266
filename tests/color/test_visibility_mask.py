import torch

from ringlight.color.visibility_mask import mask_factor, mask_gradient, straight_through_reference


def test_value_is_a_step_and_gradient_a_sigmoids():
    logits = torch.tensor([-8.0, -4.6, -4.59, 0.3, 20.0])
    assert mask_factor(logits, 0.01).tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
    upstream = torch.tensor([1.0, 2.0, -1.0, 0.5, 3.0])
    soft = logits.sigmoid()
    torch.testing.assert_close(mask_gradient(logits, upstream), upstream * soft * (1 - soft))


def test_kernel_equals_the_reference():
    logits = torch.linspace(-9, 9, 1003)
    upstream = torch.randn(1003, generator=torch.Generator().manual_seed(0))
    leaf = logits.double().requires_grad_()
    expected = straight_through_reference(leaf, 0.05)
    expected.backward(upstream.double())
    for found in (logits, logits.double()):
        assert torch.equal(mask_factor(found, 0.05).double(), expected.detach())
        gradient = mask_gradient(found, upstream.to(found)).double()
        torch.testing.assert_close(gradient, leaf.grad, rtol=1e-5, atol=5e-7)
