"""Joining and parting give what torch's own do, in value and gradient, with or without a copy."""

import pytest
import torch
from ringlight.models.parts import joined, parted

WIDTHS = (3, 1, 2)


def packed(rows: int = 5) -> torch.Tensor:
    return (torch.arange(rows * 6.0).reshape(rows, 6) * torch.ones(1)).requires_grad_() * 2


def test_neighbours_are_what_they_were_cut_from():
    whole = packed()
    assert joined(whole.split(WIDTHS, -1)) is whole


@pytest.mark.parametrize(
    "cut",
    [
        lambda whole: whole.split(WIDTHS, -1)[::-1],
        lambda whole: whole.split(WIDTHS, -1)[:2],
        lambda whole: [whole[1:, :3], whole[1:, 3:]],
        lambda whole: [whole[:, :3], whole[:, 2:]],
        lambda whole: [whole[:, :3].detach(), whole[:, 3:]],
        lambda whole: [whole[:, :3], whole[:, 3:].clone()],
        lambda whole: [whole[:, ::2], whole[:, 3:]],
        lambda whole: [whole.T.T[:, :3], whole[:, 3:]],
    ],
)
def test_all_else_is_concatenated(cut):
    found, expected = (joined(cut(packed())), torch.cat(list(cut(packed())), -1))
    assert torch.equal(found, expected)


def image() -> torch.Tensor:
    return torch.randn(6, 4, 5).permute(1, 2, 0).requires_grad_()


def test_parts_share_the_image_and_their_gradients_come_back_planar():
    leaf = image()
    parts = parted(leaf * 1, WIDTHS)
    assert [part.shape[-1] for part in parts] == list(WIDTHS)
    assert torch.equal(torch.cat(parts, -1), leaf)
    upstream = torch.randn(4, 5, 6)
    torch.autograd.backward(parts, upstream.split(WIDTHS, -1))
    assert torch.equal(leaf.grad, upstream)


def test_parts_without_gradient_get_zeros():
    leaf = image()
    first, _, _ = parted(leaf, WIDTHS)
    first.sum().backward()
    assert torch.equal(leaf.grad, torch.cat([torch.ones(4, 5, 3), torch.zeros(4, 5, 3)], -1))


class _Blocks(torch.autograd.Function):
    """Hands one block of memory back as the gradients of its three inputs."""

    block: torch.Tensor

    @staticmethod
    def forward(ctx, *parts):
        return sum(part.sum() for part in parts)

    @staticmethod
    def backward(ctx, upstream):
        return tuple(plane.permute(1, 2, 0) for plane in _Blocks.block.split(WIDTHS))


class _Memory(torch.autograd.Function):
    """Notes where the gradient of an image lies."""

    address = 0

    @staticmethod
    def forward(ctx, image):
        return image * 1

    @staticmethod
    def backward(ctx, upstream):
        _Memory.address = upstream.data_ptr()
        return upstream


def test_gradients_that_are_neighbours_are_not_copied():
    leaf = image()
    _Blocks.block = torch.randn(6, 4, 5)
    _Blocks.apply(*parted(_Memory.apply(leaf), WIDTHS)).backward()
    assert _Memory.address == _Blocks.block.data_ptr()
    assert torch.equal(leaf.grad, _Blocks.block.permute(1, 2, 0))
