"""Species model of biogeography: migration rates, species probabilities, mutation rates (Eqs 3-5).

Everything here is a function of the population size alone, so it is plain NumPy, computed once and baked
into the compiled search as constants.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def linear_rates(size: int, immigration_max: float = 1.0, emigration_max: float = 1.0) -> tuple[Array, Array]:
    """Migration rates of a ranked population, best habitat first.

    The best habitat hosts the most species: it emigrates at the full rate and takes nothing in. With unit
    maxima this is the paper's ``mu = linspace(1, 0, nPop)``, ``lambda = 1 - mu`` (section 4.1).

    Args:
        size: number of habitats P.
        immigration_max: I, the largest immigration rate.
        emigration_max: E, the largest emigration rate.

    Returns:
        ``(immigration, emigration)``, each [P], probabilities.
    """
    share = np.linspace(1.0, 0.0, size) if size > 1 else np.ones(1)
    return immigration_max * (1.0 - share), emigration_max * share


def constant_rates(size: int, immigration: float = 0.8, emigration: float = 0.2) -> tuple[Array, Array]:
    """The same rates for every habitat, as section 4.2 has them for the mission planner. Each [P]."""
    return np.full(size, immigration), np.full(size, emigration)


def species_derivative(probability: Array, immigration: Array, emigration: Array) -> Array:
    """Right-hand side of Eq. 4: d P_S / dt for S = 0..n.

    Args:
        probability: P_S, [n + 1].
        immigration: lambda_S, [n + 1], per unit time; lambda_n is not used.
        emigration: mu_S, [n + 1], per unit time; mu_0 is not used.

    Differences from the paper:
        The first case is printed with lambda_1 where balance needs mu_1; this uses mu_1, so that the sum of
        the derivatives vanishes.
    """
    up = immigration[:-1] * probability[:-1]
    down = emigration[1:] * probability[1:]
    net = down - up
    return np.concatenate([net, [0.0]]) - np.concatenate([[0.0], net])


def stationary_law(immigration: Array, emigration: Array) -> Array:
    """Stationary solution of Eq. 4 by detailed balance, P_{S+1} = P_S lambda_S / mu_{S+1}, normalised.

    Args:
        immigration: lambda_S for S = 0..n, [n + 1]; positive but for the last.
        emigration: mu_S for S = 0..n, [n + 1]; positive but for the first.

    Returns:
        P_S, [n + 1], summing to one. With lambda_S = I (1 - S/n), mu_S = E S/n and E = I it is exactly
        Binomial(n, 1/2).
    """
    log_ratio = np.log(immigration[:-1]) - np.log(emigration[1:])
    log_law = np.concatenate([[0.0], np.cumsum(log_ratio)])
    law = np.exp(log_law - log_law.max())
    return law / law.sum()


def species_law(count: int, immigration_max: float = 1.0, emigration_max: float = 1.0) -> Array:
    """P_S for S = 0..n under lambda_S = I (1 - S/n), mu_S = E S/n. Returns [n + 1]."""
    species = np.arange(count + 1)
    return stationary_law(immigration_max * (1.0 - species / count), emigration_max * species / count)


def mutation_rates(size: int, mutation_max: float) -> Array:
    """Mutation rate of each rank, best habitat first: m(S) = m_max (1 - P_S / P_max) (Eq. 5).

    Rank k hosts S = n - k species of n = P - 1. Unlikely species counts, the very good and the very bad,
    mutate most; with linear rates m is within 10 % of m_max for about 79 % of the ranks at P = 100, so the
    law is close to a constant rate that spares the middle of the ranking.

    Args:
        size: number of habitats P, at least 2.
        mutation_max: m_max, a probability.

    Returns:
        [P] probabilities.

    Differences from the paper:
        The printed brackets, m_max (1 - P_S) / P_max, allow rates above one.
    """
    law = species_law(size - 1)[::-1]
    return mutation_max * (1.0 - law / law.max())
