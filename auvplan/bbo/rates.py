"""Species model of biogeography: migration rates, species probabilities, mutation rates (Eqs 3-5).

Everything here is a function of the population size and the configured rates, so it is plain NumPy, computed
once and baked into the compiled search as constants.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def linear_rates(size: int, immigration_max: float = 1.0, emigration_max: float = 1.0) -> tuple[Array, Array]:
    """Migration rates of a ranked population, best habitat first.

    The best habitat hosts the most species: it emigrates at the full rate and takes nothing in. With unit
    maxima this is the paper's ``mu = linspace(1, 0, nPop)``, ``lambda = 1 - mu`` (section 4.1).

    Returns:
        ``(immigration, emigration)``, each [P], probabilities.
    """
    share = np.linspace(1.0, 0.0, size) if size > 1 else np.ones(1)
    return immigration_max * (1.0 - share), emigration_max * share


def constant_rates(size: int, immigration: float = 0.8, emigration: float = 0.2) -> tuple[Array, Array]:
    """Return the same rates for every habitat, as section 4.2 has them for the mission planner. Each [P]."""
    return np.full(size, immigration), np.full(size, emigration)


def species_derivative(probability: Array, immigration: Array, emigration: Array) -> Array:
    """Compute the right-hand side of Eq. 4, d P_S / dt for S = 0..n.

    Args:
        probability: P_S, [n + 1].
        immigration: lambda_S, [n + 1], per unit time; lambda_n is not used.
        emigration: mu_S, [n + 1], per unit time; mu_0 is not used.

    Differences from the paper:
        The first case is printed with lambda_1 where balance needs mu_1, the last with mu_{n-1} where it
        needs lambda_{n-1}; this uses what balance needs, so that the sum of the derivatives vanishes.
    """
    up = immigration[:-1] * probability[:-1]
    down = emigration[1:] * probability[1:]
    net = down - up
    return np.concatenate([net, [0.0]]) - np.concatenate([[0.0], net])


def species_step(probability: Array, immigration: Array, emigration: Array, dt: float) -> Array:
    """Advance the species probabilities by a time step (Eq. 3).

    P_S(t + dt) = P_S (1 - (lambda_S + mu_S) dt) + P_{S-1} lambda_{S-1} dt + P_{S+1} mu_{S+1} dt, one explicit
    step of Eq. 4 and its limit for dt to 0.

    Args:
        probability, immigration, emigration: as for `species_derivative`.
        dt: time step; the chance of leaving a state, (lambda_S + mu_S) dt, must not exceed one.

    Returns:
        P_S(t + dt), [n + 1], with the sum of `probability`.

    Raises:
        ValueError: `dt` is negative or so large that probabilities could become negative.
    """
    leaving = np.append(immigration[:-1], 0.0) + np.append(0.0, emigration[1:])
    if not 0.0 <= dt * leaving.max() <= 1.0:
        raise ValueError(f"dt must be in [0, {1.0 / leaving.max():g}] for these rates, got {dt:g}")
    return probability + dt * species_derivative(probability, immigration, emigration)


def stationary_law(immigration: Array, emigration: Array) -> Array:
    """Solve Eq. 4 for its stationary law by detailed balance, P_{S+1} = P_S lambda_S / mu_{S+1}, normalised.

    Args:
        immigration: lambda_S >= 0 for S = 0..n, [n + 1]; lambda_n is not used.
        emigration: mu_S for S = 0..n, [n + 1]; positive but for mu_0, which is not used.

    Returns:
        P_S, [n + 1], summing to one. With lambda_S = I (1 - S/n) and mu_S = E S/n it is exactly
        Binomial(n, I / (I + E)); with constant rates it is geometric, P_S proportional to (lambda / mu)^S.
    """
    with np.errstate(divide="ignore"):  # log 0: no habitat gets beyond a state that nothing enters
        log_ratio = np.log(immigration[:-1]) - np.log(emigration[1:])
    log_law = np.concatenate([[0.0], np.cumsum(log_ratio)])
    law = np.exp(log_law - log_law.max())
    return law / law.sum()


def mutation_rates(immigration: Array, emigration: Array, mutation_max: float) -> Array:
    """Compute the mutation rate of each rank, best habitat first: m(S) = m_max (1 - P_S / P_max) (Eq. 5).

    Rank k hosts S = n - k species of n = P - 1, and P_S is the stationary law of the rates. With linear
    rates, I = E, unlikely species counts mutate most, the very good and the very bad: m is within 10 % of
    m_max for about 79 % of the ranks at P = 100, so the law is close to a constant rate that spares the
    middle of the ranking. With the constant rates of section 4.2 the best habitat is the likeliest, and
    spared instead: m = m_max (1 - (mu / lambda)^k).

    Args:
        immigration: lambda by rank, best first, [P], at least 2.
        emigration: mu by rank, best first, [P].
        mutation_max: m_max, a probability.

    Returns:
        [P] probabilities.

    Differences from the paper:
        The printed brackets, m_max (1 - P_S) / P_max, allow rates above one.
    """
    law = stationary_law(immigration[::-1], emigration[::-1])[::-1]
    return mutation_max * (1.0 - law / law.max())
