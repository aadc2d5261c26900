"""Settings of the optimiser."""

from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import rates
from auvplan.runtime.arguments import check_settings

_RANGES = {
    "population": (2, np.inf), "iterations": (0, np.inf), "elites": (0, np.inf),
    "immigration": (0.0, 1.0), "emigration": (0.0, 1.0), "mutation_max": (0.0, 1.0),
    "mutation_genes": (0.0, np.inf), "mutation_step": (0.0, np.inf),
}  # fmt: skip


@dataclass(frozen=True)
class BBOConfig:
    """Settings of biogeography-based optimisation; hashable, so that it is a static argument of `jax.jit`.

    The defaults are those of the path planner's search, with a hundred generations.

    Attributes:
        population: number of habitats P.
        iterations: number of generations.
        elites: habitats that survive each generation unchanged.
        migration: "siv" decides and draws a donor for each SIV; "fig6" is the paper's Fig. 6.
        rates: "linear" over the ranks (section 4.1) or "constant" (section 4.2).
        immigration: I of the linear rates, or the constant lambda.
        emigration: E of the linear rates, or the constant mu.
        mutation_max: m_max of Eq. 5, a probability per SIV.
        mutation_genes: if given, the expected number of mutated SIVs a habitat; replaces `mutation_max`.
        mutation_law: "species" is Eq. 5, from the stationary law of the migration rates; "constant" gives
            every habitat the same rate.
        mutation: "uniform" draws a new value within bounds; "gaussian" (real SIVs only) takes a step; None is
            "gaussian" where SIVs are real, "uniform" where they are integers.
        mutation_step: standard deviation of the Gaussian step, as a share of each SIV's range.
        replacement: "generational" replaces all but the elites; "greedy" keeps the better of each habitat
            and its candidate.

    Raises:
        ValueError: a setting is out of its range.
    """

    population: int = 100
    iterations: int = 100
    elites: int = 2
    migration: Literal["siv", "fig6"] = "siv"
    rates: Literal["linear", "constant"] = "linear"
    immigration: float = 1.0
    emigration: float = 1.0
    mutation_max: float = 0.1
    mutation_genes: float | None = None
    mutation_law: Literal["species", "constant"] = "species"
    mutation: Literal["uniform", "gaussian"] | None = None
    mutation_step: float = 0.05
    replacement: Literal["generational", "greedy"] = "greedy"

    def __post_init__(self) -> None:
        check_settings(self, _RANGES)
        if self.elites >= self.population:
            raise ValueError(f"elites must be fewer than the population, got {self.elites}")
        if self.emigration == 0.0:
            raise ValueError("emigration must be positive")

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some settings changed."""
        return replace(self, **changes)

    def migration_rates(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``(lambda, mu)`` by rank, best first, [P] each."""
        law = rates.linear_rates if self.rates == "linear" else rates.constant_rates
        return law(self.population, self.immigration, self.emigration)

    def mutation_rate(self, dim: int) -> NDArray[np.float64]:
        """Mutation probability per SIV by rank, best first, [P], for habitats of `dim` SIVs."""
        largest = self.mutation_max if self.mutation_genes is None else min(1.0, self.mutation_genes / dim)
        if self.mutation_law == "constant":
            return np.full(self.population, largest)
        return rates.mutation_rates(*self.migration_rates(), largest)
