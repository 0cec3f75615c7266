import torch

from ringlight.color.visibility_mask import straight_through_mask


def test_value_is_a_step_and_gradient_a_sigmoids():
    logits = torch.tensor([-8.0, -4.6, -4.59, 0.3, 20.0], requires_grad=True)
    factor = straight_through_mask(logits, 0.01)
    assert factor[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
    upstream = torch.tensor([[1.0], [2.0], [-1.0], [0.5], [3.0]])
    factor.backward(upstream)
    soft = logits.detach().sigmoid()
    torch.testing.assert_close(logits.grad, upstream[:, 0] * soft * (1 - soft))
