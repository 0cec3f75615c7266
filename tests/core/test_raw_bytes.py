"""Raw bytes: everything is counted, real numbers at 32 bit."""

import torch
from torch import nn

from ringlight.core.raw_bytes import bytes_by_part


def test_parts_are_counted_at_32_bit():
    tensors = {
        "columns.means": torch.zeros(10, 3),
        "color.head.0.weight": torch.zeros(8, 4, dtype=torch.float16),
        "color.head.0.bias": torch.zeros(8, dtype=torch.float64),
        "color.codes": torch.zeros(5, dtype=torch.uint8),
        "steps": torch.tensor(3),
    }
    assert bytes_by_part(tensors) == {"columns.means": 120, "color.head": 160, "color.codes": 5, "steps": 8}


def test_nothing_of_a_module_is_forgotten():
    module = nn.Sequential(nn.Linear(4, 8), nn.BatchNorm1d(8))
    expected = sum(t.numel() * t.element_size() for t in (*module.parameters(), *module.buffers()))
    assert sum(bytes_by_part(module.state_dict()).values()) == expected
