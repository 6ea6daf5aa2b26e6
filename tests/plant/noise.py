"""Noise that no file declares: white, coloured, walking, drifting, outliers, missing rows."""

from dataclasses import dataclass

import numpy as np

from .chain import Array


@dataclass(frozen=True)
class NoiseOptions:
    """`white_um` None takes the run's noise_um; the others default to a plain, honest white instrument."""

    white_um: float | None = None
    coloured_um: float = 0.0
    """1 sigma of an AR(1) part with correlation time `correlation_s`."""
    correlation_s: float = 1.0
    walk_um_per_sqrt_s: float = 0.0
    drift_um: float = 0.0
    """1 sigma of the amplitude of a slow sine over the run (0.3 to 1 period) in each channel."""
    outlier_rate: float = 0.0
    """Share of rows with an outlier in one channel."""
    outlier_um: float = 3.0
    """1 sigma of an outlier's size."""
    missing_rate: float = 0.0
    """Share of rows the recorder lost (whole rows; never the first two nor the last)."""
    quantum_um: float = 0.0
    """Resolution of the instrument."""


PLAIN = NoiseOptions()
"""White noise of the run's noise_um and nothing else."""
QUIET = NoiseOptions(white_um=0.0)
"""No noise at all."""
LIKE_PLANAR = NoiseOptions(coloured_um=0.25, correlation_s=0.85, outlier_rate=0.0014, outlier_um=3.0)
"""What campaign planar-none shows: coloured part, rare outliers."""


def noise(t: Array, channels: int, white_um: float, options: NoiseOptions, rng: np.random.Generator) -> Array:
    """Noise of one run, (N, channels) um, on row times `t` (s)."""
    n = len(t)
    white = white_um if options.white_um is None else options.white_um
    out = rng.normal(0.0, 1.0, (n, channels)) * white
    gap = np.diff(t, prepend=t[:1])
    if options.coloured_um > 0.0:
        out += options.coloured_um * _ar1(np.exp(-gap / options.correlation_s), rng.normal(0.0, 1.0, (n, channels)))
    if options.walk_um_per_sqrt_s > 0.0:
        out += (
            np.cumsum(rng.normal(0.0, 1.0, (n, channels)) * np.sqrt(gap)[:, None], axis=0) * options.walk_um_per_sqrt_s
        )
    if options.drift_um > 0.0:
        periods, phase = rng.uniform(0.3, 1.0, channels), rng.uniform(0.0, 2.0 * np.pi, channels)
        share = ((t - t[0]) / max(t[-1] - t[0], 1e-9))[:, None]
        out += rng.normal(0.0, options.drift_um, channels) * np.sin(2.0 * np.pi * periods * share + phase)
    hit = np.flatnonzero(rng.random(n) < options.outlier_rate)
    out[hit, rng.integers(0, channels, len(hit))] += rng.normal(0.0, options.outlier_um, len(hit))
    return out


def _ar1(keep: Array, white: Array) -> Array:
    out = np.empty_like(white)
    out[0] = z = white[0]
    fresh = np.sqrt(1.0 - keep**2)
    for k in range(1, len(white)):
        z = keep[k] * z + fresh[k] * white[k]
        out[k] = z
    return out


def quantise(y: Array, quantum_um: float) -> Array:
    """Readings rounded to the instrument's resolution."""
    return np.round(y / quantum_um) * quantum_um if quantum_um > 0.0 else y


def kept_rows(n: int, rate: float, rng: np.random.Generator) -> Array:
    """Boolean (n,): rows that were not lost."""
    keep = rng.random(n) >= rate
    keep[[0, min(1, n - 1), n - 1]] = True
    return keep
