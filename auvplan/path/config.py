"""Settings of the path planner."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

from auvplan.bbo import BBOConfig
from auvplan.runtime.arguments import check_settings
from auvplan.vehicle import SpeedReading

#: m, by which the margins that a polish keeps are wider than what is asked for.
GUIDE_MARGIN = 1.0

#: m, the same for the altitude above the sea bed, of which a few metres are kept where tens are from a coast.
GUIDE_ALTITUDE = 0.2


@dataclass(frozen=True)
class Penalties:
    """Weights gamma of Eq. 12: a mean excess of 1 (see `cost.VIOLATIONS`) costs gamma straight-line times.

    The values are chosen here, so large that breaking a limit on a single segment never pays.
    """

    surge: float = 1000.0
    sway: float = 1000.0
    turn_rate: float = 1000.0
    coast: float = 1000.0
    obstacle: float = 1000.0
    current: float = 1000.0
    seabed: float = 1000.0
    pitch: float = 1000.0
    climb: float = 1000.0
    dive: float = 1000.0

    def __post_init__(self) -> None:
        check_settings(self, {part.name: (0, math.inf) for part in fields(self)})


_RANGES = {
    "quadrature": (1, math.inf), "t_series": (1, math.inf), "finer": (1, math.inf), "degree": (1, math.inf),
    "field_cells": (8, math.inf), "dense_cells": (8, math.inf), "refine_count": (1, math.inf),
    "fresh_share": (0, 1),
} | dict.fromkeys(
    ("depth_width", "uncertain_price", "coast_margin", "obstacle_margin", "passage_steps", "refine_steps",
     "refine_step_size", "settled", "fine_steps"), (0, math.inf),
)  # fmt: skip

#: Settings that the form of a path's cost depends on.
_OF_THE_COST = "control_points", "degree", "samples", "quadrature", "speed_reading", "penalties"


@dataclass(frozen=True)
class PathConfig:
    """Settings of the path planner; hashable, so that it is a static argument of `jax.jit`.

    Attributes:
        bbo: the optimiser's settings; `population` and `iterations` are the paper's nPop and Iter_max.
        control_points: free control points, without the two fixed ends.
        finer: paths that a polish still improves, or that leave something wanting, are polished again with so
            many times as many control points and segments; 1 for never.
        degree: of the B-spline; 3 is cubic.
        samples: points on the curve at which it is scored.
        quadrature: places on each segment between two samples at which the current is met; None for one in a
            search, its middle, or two where currents differ with depth, and for eight when the path is timed.
        sampled: whether paths in a current that is given as a function are searched for in samples of it: one
            compiled search serves all functions. What is found is timed and judged in the function.
        speed_reading: "track" crabs to hold the track; "eq8" points along it; "eq11" leaves the current out.
        start_shape: initial habitats as the straight line and "smooth" detours of few bends, or as "uniform"
            draws within bounds.
        width: half-width of each control point's bounds, as a share of the straight distance.
        depth_width: the same for depth; over a sea bed they reach up to the box's lesser depth in any case.
        t_series: re-planning windows of a leg; each gets iterations / t_series iterations (3.2.2).
        uncertain_price: extra seconds charged per second and unit of (1 - passability).
        coast_margin: m, least distance kept to the coast.
        obstacle_margin: m, least distance kept to collision boundaries.
        penalties: weights gamma of the violations.
        passages: paths through different passages, from time-to-reach fields, that the search starts from; 0
            for none.
        field_cells: cells of the finer ones of these fields to each side.
        dense_cells: the same of the fields that are searched again for paths that leave something wanting:
            those that break a limit, go a long way round, or are slower than one that the fields know.
        passage_steps: gradient steps that polish the passages before the search, a third of them on all and
            the others on the better half; divided among the windows of a leg as the iterations are.
        refine_steps: gradient steps that polish the elite after the search.
        refine_step_size: of the first gradient step, as a share of the bounds.
        refine_count: habitats that are polished together: the best ones after the search, and before it
            passages, so many at a time.
        settled: share of its cost by which the last polish improves a path that needs no finer one.
        fine_steps: gradient steps of a finer polish, which are as much smaller as control points are denser.
        fresh_share: share of a kept population that is redrawn when a path is re-planned.

    Raises:
        ValueError: a setting is out of its range.

    Differences from the paper:
        It has the plain search of `paper`. The default starts from passages, steps by Gaussian mutation,
        keeps the better of habitat and candidate, polishes by gradients, and redraws a share of a kept
        population.
    """

    bbo: BBOConfig = field(default_factory=lambda: BBOConfig(iterations=8))
    control_points: int = 32
    finer: int = 4
    degree: int = 3
    samples: int = 160
    quadrature: int | None = None
    sampled: bool = True
    speed_reading: SpeedReading = "track"
    start_shape: Literal["smooth", "uniform"] = "smooth"
    width: float = 0.75
    depth_width: float = 0.1
    t_series: int = 4
    uncertain_price: float = 1.0
    coast_margin: float = 10.0
    obstacle_margin: float = 5.0
    penalties: Penalties = field(default_factory=Penalties)
    passages: int = 12
    field_cells: int = 120
    dense_cells: int = 240
    passage_steps: int = 60
    refine_steps: int = 20
    refine_step_size: float = 0.002
    refine_count: int = 3
    settled: float = 5e-4
    fine_steps: int = 160
    fresh_share: float = 0.2

    def __post_init__(self) -> None:
        check_settings(self, _RANGES)
        if self.control_points < 1 or self.control_points + 2 <= self.degree:
            raise ValueError(
                f"control_points must be at least {max(1, self.degree - 1)} for degree {self.degree}"
            )
        if self.samples < self.control_points + 2:
            raise ValueError(f"samples must be at least {self.control_points + 2}, got {self.samples}")
        if self.passages < 0 or self.passages >= self.bbo.population:
            raise ValueError(f"passages must be in [0, population), got {self.passages}")
        if not self.width > 0.0:
            raise ValueError(f"width must be positive, got {self.width}")

    @classmethod
    def paper(cls, *, control_points: int = 4, width: float = 0.35) -> Self:
        """Plain BBO as section 4.1 and Fig. 6 have it: 100 habitats, 100 iterations, linear rates, m_max 0.1.

        One elite, nothing planted, the whole population kept from window to window. Where the text leaves a
        choice the reading is taken under which the violation vanishes as in Fig. 11: m(S) is the probability
        that a habitat mutates in one of its SIVs, by a Gaussian step of 5 % of its range, and control points
        keep within 35 % of the distance from the straight line. Read as a probability of every SIV, or with
        values drawn again within the bounds, mutation keeps the mean violation of the population above 1e-3
        (`python -m benchmarks.paper.readings --paths`).

        Args:
            control_points: free ones; the paper gives no number. From random habitats 100 iterations leave
                paths of ten points so winding that they take a third longer than the straight line
                (`python -m benchmarks.paper.readings`).
            width: half-width of their bounds, as a share of the straight distance.
        """
        return cls(
            bbo=BBOConfig(
                population=100,
                iterations=100,
                elites=1,
                migration="fig6",
                mutation_genes=0.1,
                replacement="generational",
            ),
            control_points=control_points,
            start_shape="uniform",
            width=width,
            passages=0,
            finer=1,
            refine_steps=0,
            fresh_share=0.0,
            sampled=False,
        )

    @classmethod
    def quick(cls) -> Self:
        """Return a fifth of the effort, for legs that are re-planned several times on the way."""
        return cls(
            bbo=cls().bbo.replace(population=32, iterations=8),
            control_points=8,
            samples=64,
            passages=4,
            field_cells=56,
            dense_cells=200,
            passage_steps=40,
            refine_steps=40,
            refine_count=2,
            settled=2e-3,
            fine_steps=80,
        )

    @classmethod
    def plain(cls) -> Self:
        """Return the search alone, with a hundred iterations: neither passages nor gradients."""
        return cls(bbo=cls().bbo.replace(iterations=100), passages=0, passage_steps=0, refine_steps=0)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some settings changed."""
        return replace(self, **changes)

    def only(self, *names: str) -> Self:
        """Return the settings that the form of a path's cost depends on and those named.

        The others are defaults.

        Programs that are compiled for it serve all settings that agree in these; `numbers` they are given.
        """
        kept: dict[str, Any] = {name: getattr(self, name) for name in (*_OF_THE_COST, *names)}
        return replace(type(self)(passages=0, finer=1), **kept)

    @property
    def numbers(self) -> dict[str, float]:
        """The settings that programs are given as numbers: margins and price."""
        names = "coast_margin", "obstacle_margin", "uncertain_price"
        return {name: getattr(self, name) for name in names}

    def fine(self) -> Self:
        """The settings of paths with `finer` times the control points and segments, and of their polish."""
        times = self.finer
        return self.replace(
            control_points=times * self.control_points,
            samples=times * (self.samples - 1) + 1,
            finer=1,
            refine_steps=self.fine_steps,
            refine_step_size=self.refine_step_size / times,
            refine_count=1 if times > 1 else self.refine_count,
        )

    def window(self) -> Self:
        """Return the settings of a window: its share of the iterations (3.2.2), and half the passages."""
        return self.replace(
            bbo=self.bbo.replace(iterations=max(1, self.bbo.iterations // self.t_series)),
            passages=-(-self.passages // 2),
            passage_steps=self.passage_steps // self.t_series,
        )
