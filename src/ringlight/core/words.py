"""Numbers with their noun, in sentences for people."""

MEGABYTE = 1e6
"""Bytes: sizes are said in powers of ten, as disks and networks count."""


def counted(number: int, noun: str) -> str:
    """ "1 step", "3,000 steps"; for nouns whose plural takes an s."""
    return numbered(number, f"{noun}s")


def numbered(number: int, nouns: str) -> str:
    """ "1 Gaussian", "3,000 Gaussians"; for what is known by its plural, as what models are made of."""
    return f"{number:,} {nouns.removesuffix('s') if number == 1 else nouns}"
