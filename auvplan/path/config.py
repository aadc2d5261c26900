"""Settings of the path planner."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

from auvplan.bbo import BBOConfig
from auvplan.vehicle import SpeedReading


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


@dataclass(frozen=True)
class PathConfig:
    """Settings of the path planner; hashable, so that it is a static argument of `jax.jit`.

    Attributes:
        bbo: the optimiser's settings; `population` and `iterations` are the paper's nPop and Iter_max.
        control_points: free control points, without the two fixed ends.
        degree: of the B-spline; 3 is cubic.
        samples: points on the curve at which it is scored.
        speed_reading: "track" crabs to hold the track; "eq8" points along it; "eq11" leaves the current out.
        start_shape: initial habitats as "smooth" detours of few bends, or "uniform" draws within bounds.
        width: half-width of each control point's bounds, as a share of the straight distance.
        depth_width: the same for depth.
        sweeps: passes that settle arrival times where the current changes with time.
        t_series: re-planning windows of a leg; each gets iterations / t_series iterations (3.2.2).
        uncertain_price: extra seconds charged per second and unit of (1 - passability).
        coast_margin: m, least distance kept to the coast.
        obstacle_margin: m, least distance kept to collision boundaries.
        penalties: weights gamma of the violations.
        refine_steps: gradient steps that polish the elite after the search; 0 leaves the search as it is.
        refine_count: habitats that are polished.
        fresh_share: share of a kept population that is redrawn when a path is re-planned.

    Raises:
        ValueError: a setting is out of its range.
    """

    bbo: BBOConfig = field(
        default_factory=lambda: BBOConfig(replacement="greedy", mutation="gaussian", mutation_step=0.05)
    )
    control_points: int = 10
    degree: int = 3
    samples: int = 128
    speed_reading: SpeedReading = "track"
    start_shape: Literal["smooth", "uniform"] = "smooth"
    width: float = 0.5
    depth_width: float = 0.1
    sweeps: int = 3
    t_series: int = 4
    uncertain_price: float = 1.0
    coast_margin: float = 10.0
    obstacle_margin: float = 5.0
    penalties: Penalties = field(default_factory=Penalties)
    refine_steps: int = 60
    refine_count: int = 4
    fresh_share: float = 0.2

    def __post_init__(self) -> None:
        if self.control_points < 1 or self.control_points + 2 <= self.degree:
            raise ValueError(
                f"control_points must be at least {max(1, self.degree - 1)} for degree {self.degree}"
            )
        if self.samples < self.control_points + 2:
            raise ValueError(f"samples must be at least {self.control_points + 2}, got {self.samples}")
        if self.t_series < 1 or self.sweeps < 1:
            raise ValueError("t_series and sweeps must be at least 1")
        if not self.width > 0.0 or not self.depth_width >= 0.0:
            raise ValueError("width must be positive and depth_width not negative")

    @classmethod
    def paper(cls) -> Self:
        """Plain BBO as section 4.1 has it: 100 habitats, 100 iterations, linear rates, m_max 0.1."""
        return cls(
            bbo=BBOConfig(population=100, iterations=100, mutation_max=0.1),
            start_shape="uniform",
            refine_steps=0,
        )

    def replace(self, **changes: Any) -> Self:
        """A copy with some settings changed."""
        return replace(self, **changes)

    @property
    def window_iterations(self) -> int:
        """Iterations that a re-planning window gets."""
        return max(1, self.bbo.iterations // self.t_series)
