"""Counter-based randomness: a number depends on (seed, step, purpose) and on nothing that ran before."""

import hashlib

import torch


def generator(seed: int, step: int, purpose: str) -> torch.Generator:
    """A fresh generator for one purpose at one step; runs that stop and resume draw the same numbers."""
    digest = hashlib.sha256(f"{seed}/{step}/{purpose}".encode()).digest()
    # 63 bits, for torch refuses seeds beyond the range of a signed 64-bit integer; it uses the lower 32.
    return torch.Generator().manual_seed(int.from_bytes(digest[:8], "little") >> 1)
