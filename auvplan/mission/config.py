"""Settings of the mission planner."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from auvplan.bbo import BBOConfig
from auvplan.mission.decoder import DecoderName
from auvplan.mission.objective import ObjectiveName
from auvplan.mission.speeds import Saved
from auvplan.runtime.arguments import check_settings

_BBO = BBOConfig(population=150, iterations=200, mutation_genes=2.0, mutation_law="constant")

_RANGES = {
    "rate_weight": (0, np.inf), "phi1": (0, np.inf), "phi2": (0, np.inf), "time_weight": (0, np.inf),
    "beam_width": (1, np.inf), "local_rounds": (0, np.inf), "local_width": (1, np.inf),
    "local_period": (1, np.inf), "ruins": (0, np.inf), "degree": (1, np.inf), "seeds": (0, np.inf),
    "levels": (1, np.inf),
}  # fmt: skip


@dataclass(frozen=True)
class MissionConfig:
    """Settings of the mission planner; hashable, so that it is a static argument of `jax.jit`.

    Attributes:
        bbo: the optimiser's settings.
        decoder: "rate", "timely" or "paper", see `auvplan.mission.decoder`.
        objective: "priority" or "eq15", see `auvplan.mission.objective`.
        rate_weight: what an edge of average rate adds to a SIV at most ("rate" only).
        time_weight: w of "priority", what T_available is worth at most as a share of the largest priority, in
            [0, 1). It is never worth so much that priority is given up for time.
        phi1: Phi_1 of "eq15", per second; the paper gives no value.
        phi2: Phi_2 of "eq15"; the paper gives no value.
        plant: whether the search starts with the shortest, the greediest and a known route among its
            habitats, and with the destination as everybody's last resort; otherwise all are random.
        seeds: habitats taken from a beam search before the evolution starts, see `auvplan.mission.beam`; none
            if zero.
        beam_width: partial routes that the beam keeps; None is 512 on sparse graphs, fewer on dense ones, and
            four times as many for "eq15", which rewards filling the time to the second.
        local_rounds: changes that a memetic step makes to a route at most, see
            `auvplan.mission.local_search`; no memetic steps if zero.
        local_width: habitats that a memetic step starts from.
        local_period: iterations between memetic steps.
        ruins: rounds of ruin and recreate at last, at most, see `auvplan.mission.recreate`; none if zero, and
            without memetic steps.
        degree: places for neighbours of a waypoint at least; set it to the largest degree of the first graph
            where later ones lose edges, and nothing compiles again.
        saves: what decides between routes of equal priority where energy is limited, "time" or "energy".
        levels: at which speeds are tried where they are free, from least energy to least time.

    Raises:
        ValueError: a setting is out of its range, or no elite would keep the shortest mission alive.
    """

    bbo: BBOConfig = _BBO
    decoder: DecoderName = "rate"
    objective: ObjectiveName = "priority"
    rate_weight: float = 100.0
    time_weight: float = 0.05
    phi1: float = 1.0
    phi2: float = 100.0
    plant: bool = True
    seeds: int = 20
    beam_width: int | None = None
    local_rounds: int = 3
    local_width: int = 20
    local_period: int = 40
    ruins: int = 100
    degree: int = 16
    saves: Saved = "time"
    levels: int = 16

    def __post_init__(self) -> None:
        check_settings(self, _RANGES)
        if not self.time_weight < 1.0:
            raise ValueError(f"time_weight must be less than 1, got {self.time_weight}")
        if self.local_width > self.bbo.population:
            raise ValueError(f"local_width must be at most bbo.population, got {self.local_width}")
        if self.seeds > self.bbo.population - 4:
            raise ValueError(f"seeds must be at most bbo.population - 4, got {self.seeds}")
        if self.seeds and not self.plant:
            raise ValueError("seeds of a beam search need plant")
        if self.bbo.replacement == "generational" and self.bbo.elites < 1:
            raise ValueError("bbo.elites must be at least 1, so that a feasible mission once found is kept")
        if self.bbo.mutation == "gaussian":
            raise ValueError('bbo.mutation must be "uniform": SIVs are integers')

    @classmethod
    def paper(cls) -> Self:
        """Section 4.2 and Fig. 6: 150 random habitats, 200 iterations, mu = 0.2, lambda = 0.8, m(S) = 0.5.

        One elite, nothing planted, routes decoded without a look at the time, Eq. 15. As in
        `PathConfig.paper`, m(S) is the probability that a habitat mutates in one of its SIVs.
        """
        bbo = BBOConfig(
            population=150,
            iterations=200,
            elites=1,
            migration="fig6",
            rates="constant",
            immigration=0.8,
            emigration=0.2,
            mutation_genes=0.5,
            replacement="generational",
        )
        return cls(bbo=bbo, decoder="paper", objective="eq15", plant=False, seeds=0, local_rounds=0)

    @classmethod
    def plain(cls) -> Self:
        """Return the search alone: neither routes from a beam nor local search."""
        return cls(seeds=0, local_rounds=0)

    @classmethod
    def quick(cls) -> Self:
        """Return the default for a fifth of the time, as it does for re-planning from a known route."""
        return cls().quicker()

    def quicker(self) -> Self:
        """Return the same settings for a fifth of the time."""
        return self.replace(bbo=self.bbo.replace(iterations=10), beam_width=256, ruins=self.ruins // 5)

    def beam(self, size: int, degree: int) -> tuple[int, int]:
        """Partial routes that a beam keeps, and how many of them may end at one waypoint.

        Args:
            size: number of waypoints N.
            degree: places for neighbours K; denser graphs get narrower beams, for the same time.
        """
        width = self.beam_width
        if width is None:
            width = max(128, min(512, 10_240 // degree)) * (4 if self.objective == "eq15" else 1)
        return width, max(2, 4 * width // size)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some settings changed."""
        return replace(self, **changes)
