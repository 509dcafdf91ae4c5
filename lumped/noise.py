"""Names of self-excited brake noise by frequency."""

from __future__ import annotations

GROAN_BELOW_HZ = 100.0
SQUEAL_FROM_HZ = 1000.0


def name_noise(frequency_hz: float) -> str:
    """Return what an instability of this frequency is heard as.

    Groan lies below 0.1 kHz, squeal from 1 kHz on, moan between. What does not oscillate makes no sound.

    Examples
    --------
    >>> [name_noise(f) for f in (0.0, 60.0, 400.0, 2300.0)]
    ['divergence', 'groan', 'moan', 'squeal']
    """
    if frequency_hz <= 0:
        return "divergence"
    if frequency_hz < GROAN_BELOW_HZ:
        return "groan"
    return "moan" if frequency_hz < SQUEAL_FROM_HZ else "squeal"
