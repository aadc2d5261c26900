"""Settings of the optimiser."""

from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import rates

_CHOICES = {
    "migration": ("siv", "fig6", "differential", "covariance"),
    "rates": ("linear", "constant"),
    "mutation_law": ("species", "constant"),
    "mutation": ("uniform", "gaussian"),
    "replacement": ("generational", "greedy"),
}


@dataclass(frozen=True)
class BBOConfig:
    """Settings of biogeography-based optimisation; hashable, so that it is a static argument of `jax.jit`.

    Attributes:
        population: number of habitats P.
        iterations: number of generations.
        elites: habitats that survive each generation unchanged.
        migration: "siv" decides and draws a donor for each SIV; "fig6" is the paper's Fig. 6. Two more favour
            no axis, for real SIVs: "differential" moves habitats along differences of ranked ones,
            "covariance" draws them from an adapted normal law. They keep the P best habitats ever met, and
            use none of the settings of mutation, elites and replacement.
        rates: "linear" over the ranks (section 4.1) or "constant" (section 4.2).
        immigration: I of the linear rates, or the constant lambda.
        emigration: E of the linear rates, or the constant mu.
        mutation_max: m_max of Eq. 5, a probability per SIV.
        mutation_genes: if given, the expected number of mutated SIVs a habitat; replaces `mutation_max`.
        mutation_law: "species" is Eq. 5, from the stationary law of the migration rates; "constant" gives
            every habitat the same rate.
        mutation: "uniform" draws a new value within bounds; "gaussian" (real SIVs only) takes a step.
        mutation_step: standard deviation of the Gaussian step, as a share of each SIV's range.
        replacement: "generational" replaces all but the elites; "greedy" keeps the better of each habitat
            and its candidate.
        restarts: times that "differential" or "covariance" migration starts from fresh habitats, at most,
            when it stalls; the best are kept. Each restart of "covariance" pools twice as many habitats.

    Raises:
        ValueError: a setting is out of its range.
    """

    population: int = 100
    iterations: int = 100
    elites: int = 2
    migration: Literal["siv", "fig6", "differential", "covariance"] = "siv"
    rates: Literal["linear", "constant"] = "linear"
    immigration: float = 1.0
    emigration: float = 1.0
    mutation_max: float = 0.1
    mutation_genes: float | None = None
    mutation_law: Literal["species", "constant"] = "species"
    mutation: Literal["uniform", "gaussian"] = "uniform"
    mutation_step: float = 0.1
    replacement: Literal["generational", "greedy"] = "generational"
    restarts: int = 0

    def __post_init__(self) -> None:
        if self.population < 2:
            raise ValueError(f"population must be at least 2, got {self.population}")
        if self.iterations < 0:
            raise ValueError(f"iterations must not be negative, got {self.iterations}")
        if not 0 <= self.elites < self.population:
            raise ValueError(f"elites must be in [0, population), got {self.elites}")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} must be one of {choices}, got {getattr(self, name)!r}")
        if self.mutation_genes is not None and not self.mutation_genes >= 0.0:
            raise ValueError(f"mutation_genes must not be negative, got {self.mutation_genes}")
        if not self.mutation_step >= 0.0:
            raise ValueError(f"mutation_step must not be negative, got {self.mutation_step}")
        for name in ("immigration", "emigration", "mutation_max"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}")
        if self.restarts < 0:
            raise ValueError(f"restarts must not be negative, got {self.restarts}")
        if self.restarts and self.migration not in ("differential", "covariance"):
            raise ValueError('restarts need migration="differential" or "covariance"')
        if self.migration == "differential" and self.population < 4:
            raise ValueError(f"population must be at least 4 to take differences, got {self.population}")
        if self.emigration == 0.0:
            raise ValueError("emigration must be positive")

    @classmethod
    def rotated(
        cls,
        dim: int,
        evaluations: int = 10_100,
        migration: Literal["differential", "covariance"] = "covariance",
    ) -> Self:
        """Settings for a continuous problem whose SIVs act together.

        Args:
            dim: number of SIVs D.
            evaluations: of the cost function, at most; the population is small beside it.
            migration: a variant that favours no axis.

        Raises:
            ValueError: too few evaluations for one population.
        """
        size = 50 if migration == "differential" else 4 + int(3.0 * np.log(dim))
        if evaluations < size:
            raise ValueError(f"evaluations must be at least {size}, got {evaluations}")
        return cls(population=size, iterations=evaluations // size - 1, migration=migration, restarts=9)

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
