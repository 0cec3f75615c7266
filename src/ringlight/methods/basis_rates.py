"""Learning rates of a basis that Gaussians share, and of their weights, by the length of a run."""

from ringlight.fit.rates import between, how_long

SHORT_RATE, LONG_RATE = 5e-3, 3e-4
"""Of the weights, in short runs and in those of 30,000 steps. Long runs at the high rate know training views by heart:
``ringlight-basis`` loses 0.15 dB on held-out ones of lego_400 (docs/experiments/results.md), ``ringlight-mirror`` 2.3
on those of toaster_400 (docs/experiments/mirrors.md). Short runs need it: with a fifth of their rate the shared
functions cost ``ringlight-basis`` 0.3 dB."""

SHARED_FASTER = 2
"""How much faster what is shared learns."""

OPACITY_FASTER = 4
"""How much faster than those of colour the shared functions of opacity learn: they are logits, and one changes an
opacity by a quarter at most."""


def basis_rates(
    steps: int, short: int, weights: float | None, basis: float | None, opacities: float | None
) -> tuple[float, float, float]:
    """Of the weights, and of shared functions of colour and opacity: as they are set, or what suits ``steps``.

    Runs of up to ``short`` steps are short ones.
    """
    usual = between(SHORT_RATE, LONG_RATE, how_long(steps, short))
    of_basis = SHARED_FASTER * usual if basis is None else basis
    return (
        usual if weights is None else weights,
        of_basis,
        OPACITY_FASTER * of_basis if opacities is None else opacities,
    )
