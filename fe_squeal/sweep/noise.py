"""Names of brake noise by its frequency."""

from __future__ import annotations

# Bounds between the kinds of noise, see `classify_noise`.
GROAN_BELOW_HZ = 100.0
SQUEAL_FROM_HZ = 1000.0


def classify_noise(frequency_hz: float) -> str:
    """Return the name of the noise that an instability of this frequency makes.

    Creep groan is below 100 Hz, squeal from 1 kHz to beyond 10 kHz, and moan and howl are between these (A. Akay,
    "Acoustics of friction", J. Acoust. Soc. Am. 111, 2002). An instability that does not oscillate makes no sound and
    is called divergence.

    Examples
    --------
    >>> [classify_noise(f) for f in (0.0, 60.0, 400.0, 2300.0)]
    ['divergence', 'groan', 'moan', 'squeal']
    """
    if frequency_hz <= 0:
        return "divergence"
    if frequency_hz < GROAN_BELOW_HZ:
        return "groan"
    return "moan" if frequency_hz < SQUEAL_FROM_HZ else "squeal"
