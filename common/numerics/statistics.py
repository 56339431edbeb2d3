"""Statistics for measured times and random samples: medians with their noise, confidence, chi-square tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

MAD_TO_SIGMA = 1 / NormalDist().inv_cdf(0.75)
"""A normal distribution has its quartiles this many times closer to the middle than its standard deviation: 1.4826."""


@dataclass(frozen=True)
class Estimate:
    """A measured quantity: its median, the confidence interval of the median, and how samples scatter.

    `noise` is 1.4826 * MAD, the standard deviation that normal samples of this spread would have; a few samples that
    were interrupted do not move it. `low` and `high` are samples.
    """

    median: float
    low: float
    high: float
    noise: float
    count: int

    def overlaps(self, other: Estimate) -> bool:
        """Whether the intervals meet, so that neither can be called the larger."""
        return self.low <= other.high and other.low <= self.high


def mad(samples: ArrayLike) -> float:
    """Return the median absolute deviation from the median."""
    values = _samples(samples)
    return float(np.median(np.abs(values - np.median(values))))


def noise(samples: ArrayLike) -> float:
    """Return the standard deviation estimated from the median absolute deviation."""
    return MAD_TO_SIGMA * mad(samples)


def estimate(samples: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Return median, its confidence interval and noise, with no assumption on the distribution.

    The number of samples below the true median is binomial with p = 1/2, so the k-th smallest and k-th largest hold
    it between them with a probability known exactly (Conover, Practical Nonparametric Statistics, section 3.2).
    With too few samples for `confidence` (five or fewer for 0.95) the interval is all of them.

    Raises:
        ValueError: no samples, one that is not finite, or a confidence outside (0, 1).
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"a confidence is between 0 and 1, not {confidence}")
    values = np.sort(_samples(samples))
    count = len(values)
    rank = _rank_below_median(count, (1.0 - confidence) / 2)
    return Estimate(
        median=float(np.median(values)),
        low=float(values[rank]),
        high=float(values[count - 1 - rank]),
        noise=noise(values),
        count=count,
    )


def _rank_below_median(count: int, tail: float) -> int:
    """Return the largest k with P(k or fewer of `count` samples lie below the median) <= `tail`, at least 0."""
    if count > 1000:  # 0.5^count would vanish, and the normal approximation is off by less than a rank
        return max(math.floor(count / 2 + NormalDist().inv_cdf(tail) * math.sqrt(count) / 2) - 1, 0)
    total, term, fitting = 0.0, 0.5**count, 0
    while total + term <= tail:
        total += term
        term *= (count - fitting) / (fitting + 1)
        fitting += 1
    return max(fitting - 1, 0)


def mean_interval(samples: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return (mean, half width) of the confidence interval of the mean, by the central limit theorem.

    Raises:
        ValueError: fewer than two samples, one that is not finite, or a confidence outside (0, 1).
    """
    values = _samples(samples)
    if len(values) < 2 or not 0.0 < confidence < 1.0:
        raise ValueError(
            f"{len(values)} samples have no interval of confidence {confidence}: give two, and 0 to 1"
        )
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    return float(values.mean()), z * float(values.std(ddof=1)) / math.sqrt(len(values))


def chi_square_tail(statistic: float, freedom: int) -> float:
    """Return P(X >= statistic) for the chi-square distribution with `freedom` degrees.

    It is the regularised upper incomplete gamma function Q(freedom / 2, statistic / 2), by its series below its
    middle (NIST DLMF 8.11.4) and by its continued fraction above (8.9.2, Lentz's method).
    """
    if freedom < 1 or not statistic >= 0.0:
        raise ValueError(f"chi-square has no tail at {statistic} for {freedom} degrees of freedom")
    a, x = freedom / 2, statistic / 2
    if x == 0.0:
        return 1.0
    if math.isinf(x):
        return 0.0
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1:
        term = total = 1 / a
        step = a
        while term > total * 1e-17:
            step += 1
            term *= x / step
            total += term
        return max(0.0, 1.0 - scale * total)
    b, tiny = x + 1 - a, 1e-300
    c, d = 1 / tiny, 1 / b
    fraction = d
    for n in range(1, 100_000):
        numerator = -n * (n - a)
        b += 2
        d = 1 / ((numerator * d + b) or tiny)
        c = (b + numerator / c) or tiny
        fraction *= c * d
        if abs(c * d - 1) < 1e-16:
            break
    return scale * fraction


@dataclass(frozen=True)
class ChiSquare:
    """Outcome of a chi-square test; `p` is the probability of a fit at least this bad by chance."""

    statistic: float
    freedom: int
    p: float


def chi_square(observed: ArrayLike, expected: ArrayLike, smallest: float = 5.0) -> ChiSquare:
    """Compare counts of samples in cells with the counts that their density predicts (Pearson's test).

    Cells that expect fewer than `smallest` samples are put together, smallest first, since the distribution holds
    for large counts alone. A sample where none can be is never chance, and p is 0.

    Raises:
        ValueError: different shapes, negative or non-finite counts, totals that differ by more than 1e-6, or fewer
            than two cells left.
    """
    counts, wanted = _samples(observed), _samples(expected)
    if counts.shape != wanted.shape or min(counts.min(), wanted.min()) < 0:
        raise ValueError(
            f"chi-square needs counts of one shape and not below 0: {counts.shape}, {wanted.shape}"
        )
    if abs(counts.sum() - wanted.sum()) > 1e-6 * counts.sum():
        raise ValueError(f"{counts.sum():g} samples, but the density predicts {wanted.sum():g}")
    impossible = wanted == 0
    if counts[impossible].any():
        return ChiSquare(math.inf, 1, 0.0)
    order = np.argsort(wanted[~impossible], kind="stable")
    counts, wanted = counts[~impossible][order], wanted[~impossible][order]
    # The shortest run of small cells that together expect enough; everything small goes into it.
    small = int(np.searchsorted(wanted, smallest))
    if small:
        while small < len(wanted) and wanted[:small].sum() < smallest:
            small += 1
        counts = np.append(counts[small:], counts[:small].sum())
        wanted = np.append(wanted[small:], wanted[:small].sum())
    if len(wanted) < 2:
        raise ValueError("fewer than two cells expect enough samples: draw more, or use larger cells")
    statistic = float(((counts - wanted) ** 2 / wanted).sum())
    freedom = len(wanted) - 1
    return ChiSquare(statistic, freedom, chi_square_tail(statistic, freedom))


def level_of_each(level: float, tests: int) -> float:
    """Return the level at which each of independent `tests` may fail so that any fails with probability `level`.

    Šidák 1967: 1 - (1 - level)^(1 / tests).
    """
    return -math.expm1(math.log1p(-level) / tests)


def _samples(samples: ArrayLike) -> Float64:
    values = np.asarray(samples, np.float64).reshape(-1)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError("no samples" if values.size == 0 else "a sample is not finite")
    return values
