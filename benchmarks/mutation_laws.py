"""What the species law behind the mutation rates (Eq. 5) is worth to searches with constant migration.

``python -m benchmarks.mutation_laws`` runs the paper's mission preset (lambda = 0.8, mu = 0.2, m_max = 0.5)
on generated graphs of 40 waypoints, and plain biogeography-based optimisation with the same rates on a small
function, under three laws of mutation by rank.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import auvplan as ap
from auvplan.bbo import BBOConfig, minimize, rates
from benchmarks.harness import launch, show
from benchmarks.mission_sets import generated_cases

#: SIVs of the small function, each within +-5.12.
DIM = 10


@dataclass(frozen=True)
class OfLinearRates(BBOConfig):
    """Mutation by the species law of linear unit rates, whatever the rates of migration are."""

    def mutation_rate(self, dim: int) -> NDArray[np.float64]:
        largest = self.mutation_max if self.mutation_genes is None else min(1.0, self.mutation_genes / dim)
        return rates.mutation_rates(*rates.linear_rates(self.population), largest)


#: The same search under three laws of mutation.
LAWS: dict[str, Callable[[BBOConfig], BBOConfig]] = {
    "of the configured rates (Eq. 5)": lambda bbo: bbo,
    "of linear unit rates": lambda bbo: OfLinearRates(**vars(bbo)),
    "m_max for all": lambda bbo: bbo.replace(mutation_law="constant"),
}


def rastrigin(x: jax.Array) -> jax.Array:
    """[P] of [P, D]: a bowl full of dents, least 0 at the origin."""
    return (x * x - 10.0 * jnp.cos(2.0 * jnp.pi * x) + 10.0).sum(axis=1)


def search_costs(bbo: BBOConfig, seeds: int) -> NDArray[np.float64]:
    """Best cost on the small function, [seeds]."""
    low, high = np.full(DIM, -5.12), np.full(DIM, 5.12)
    runs = [minimize(rastrigin, low, high, key=jax.random.key(seed), config=bbo) for seed in range(seeds)]
    return np.asarray([float(run.cost) for run in runs])


def mission_costs(bbo: BBOConfig, seeds: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cost of Eq. 15 and total priority of the routes found, [graphs x seeds] each."""
    config = replace(ap.MissionConfig.paper(), bbo=bbo)
    routes = []
    for case, seed in product(generated_cases(sizes=(40,)), range(seeds)):
        asked = case.graph, case.start, case.goal, case.time_available
        routes.append(ap.plan_mission(*asked, speed=case.speed, key=jax.random.key(seed), config=config))
    return np.asarray([route.cost for route in routes]), np.asarray([route.priority for route in routes])


def main(seeds: int) -> None:
    small, rows = ap.MissionConfig.paper().bbo, []
    for name, law in LAWS.items():
        cost, priority = mission_costs(law(small), seeds)
        values = {"cost": cost, "priority": priority}
        values["found"] = search_costs(law(small).replace(mutation_max=0.1), seeds)
        cells = {key: f"{each.mean():.4g} ({each.std(ddof=1):.2g})" for key, each in values.items()}
        rows.append({"name": name} | cells)
    columns = {
        "mutation by rank": "{name}", "Eq. 15, 3 graphs": "{cost}", "total priority": "{priority}",
        f"Rastrigin, {DIM} SIVs": "{found}",
    }  # fmt: skip
    show(f"Laws of mutation under constant migration rates, {seeds} seeds: mean (std)", rows, columns)


if __name__ == "__main__":
    launch(main, seeds=(10, "runs of each problem"))
