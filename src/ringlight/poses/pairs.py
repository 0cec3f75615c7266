"""Which pairs of photographs are compared: all, or those next to each other and those that look alike.

What looks alike is found by VLAD (Jegou et al., "Aggregating local descriptors into a compact image representation",
CVPR 2010) over words that are learned from the photographs themselves, so that no vocabulary is downloaded.
"""

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float, UInt8

MOST_EXHAUSTIVE = 150
"""Photographs up to which all pairs are compared: 11,175 pairs."""

NEXT_BY_NAME = 10
"""Photographs that follow, each of which is compared: names tell the order of shooting."""

ALIKE = 20
"""Photographs that look most alike, each of which is compared."""

WORDS, ROUNDS = 64, 10
"""Of the vocabulary, and of k-means."""

SAMPLES, SAMPLES_EACH = 20_000, 400
"""Descriptors from which words are learned, and from one photograph; also the most that describe a photograph."""

Pairs = list[tuple[str, str]]
Descriptors = Callable[[str], UInt8[np.ndarray, "F 128"]]


def all_pairs(names: Sequence[str]) -> Pairs:
    """Every photograph with every other."""
    return list(combinations(sorted(names), 2))


def neighbour_pairs(names: Sequence[str], descriptors: Descriptors, seed: int) -> Pairs:
    """Each photograph with those next by name, at distances of 1 to 10 and then powers of two, and with those that look
    most like it."""
    ordered = sorted(names)
    pairs = set(_next(ordered))
    looks = vlad([descriptors(name) for name in ordered], seed)
    likeness = looks @ looks.T
    np.fill_diagonal(likeness, -np.inf)
    for index, row in enumerate(likeness):
        for other in np.argsort(-row, kind="stable")[: min(ALIKE, len(ordered) - 1)]:
            one, two = sorted((index, int(other)))
            pairs.add((ordered[one], ordered[two]))
    return sorted(pairs)


def _next(ordered: Sequence[str]) -> Pairs:
    distances = [*range(1, NEXT_BY_NAME + 1), *(2**power for power in range(4, 8))]
    return [
        (ordered[index], ordered[index + distance])
        for distance in distances
        for index in range(len(ordered) - distance)
    ]


def vlad(photographs: Sequence[UInt8[np.ndarray, "_ 128"]], seed: int) -> Float[np.ndarray, "V D"]:
    """One unit vector a photograph; the product of two is their likeness. A photograph without features is zero."""
    rng = np.random.default_rng(seed)
    chosen = [_sampled(one, SAMPLES_EACH, rng).astype(np.float32) / 255 for one in photographs]
    together = np.concatenate(chosen) if chosen else np.zeros((0, 128), np.float32)
    if not len(together):
        return np.zeros((len(photographs), 1), np.float32)
    words = _words(_sampled(together, SAMPLES, rng), rng)
    return np.stack([_residuals(one, words) for one in chosen])


def _words(samples: Float[np.ndarray, "N 128"], rng: np.random.Generator) -> Float[np.ndarray, "W 128"]:
    """Lloyd's k-means; a word that nothing is nearest to stays where it is."""
    words = _sampled(samples, WORDS, rng).copy()
    for _ in range(ROUNDS):
        nearest = _nearest(samples, words)
        for word in range(len(words)):
            mine = samples[nearest == word]
            if len(mine):
                words[word] = mine.mean(0)
    return words


def _residuals(features: Float[np.ndarray, "F 128"], words: Float[np.ndarray, "W 128"]) -> Float[np.ndarray, "D"]:
    """Sum of the differences from each word, with signed square roots, of unit length."""
    sums = np.zeros_like(words)
    nearest = _nearest(features, words)
    np.add.at(sums, nearest, features - words[nearest])
    vector = (np.sign(sums) * np.sqrt(np.abs(sums))).ravel()
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector


def _nearest(features: Float[np.ndarray, "F 128"], words: Float[np.ndarray, "W 128"]) -> np.ndarray:
    return np.argmin((words**2).sum(1) - 2 * features @ words.T, axis=1)


def _sampled(rows: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return rows if len(rows) <= most else rows[np.sort(rng.choice(len(rows), most, replace=False))]
