"""Random paths that the planner calls clear, walked in steps of a metre by the checker of saved runs.

`python -m benchmarks.path_walks` draws smooth paths past islands and drifting obstacles, and walks those that
the planner's kernel holds free of any violation with no margin at all.
"""

from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import auvplan as ap
from auvplan.check.track import Coast, SampledTrack
from auvplan.path.cost import Trajectory, curves, evaluate, violations
from benchmarks.harness import launch, screen
from benchmarks.scoring import Problem, problem

COUNT = 10_000

#: Paths drawn for each world; worlds are drawn until there are enough clear paths.
_DRAWN = 2000


@dataclass(frozen=True)
class Walked:
    drawn: int
    paths: int  # of them that the planner called clear
    collisions: int  # of those that touch something
    metres: float  # walked
    nearest: float  # m, least distance to a collision boundary


def walks(count: int, seed: int = 0) -> Walked:
    """Walk at least `count` paths that the planner calls clear."""
    drawn = found = hit = 0
    metres, nearest = 0.0, np.inf
    world = seed
    while found < count:
        leg = problem(world)
        chart = leg.env.chart
        assert chart is not None
        land, origin = np.asarray(chart.passability) == 0.0, np.asarray(chart.origin, float)
        coast = Coast(land, origin, float(chart.pixel_size), np.zeros((0, 2)))
        positions, times = _clear_paths(leg, world)
        drawn, world = drawn + _DRAWN, world + 1
        for path, when in zip(positions[: count - found], times, strict=False):
            touched, length, near = _walk(leg.env.obstacles, coast, path, when)
            hit, metres, nearest = hit + touched, metres + length, min(nearest, near)
        found += min(len(positions), count - found)
    return Walked(drawn, found, hit, metres, nearest)


def _clear_paths(leg: Problem, seed: int) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Positions [P, S, 3] m and times [P, S] s of random paths that break no limit, without margins."""
    config, vehicle = leg.config.replace(coast_margin=0.0, obstacle_margin=0.0), ap.Vehicle(turn_rate_max=1e6)

    @jax.jit
    def executed(paths: jax.Array) -> Trajectory:
        return evaluate(curves(paths, leg.start, leg.goal, config), jnp.zeros(()), leg.env, vehicle, config)

    trajectory = executed(leg.paths(_DRAWN, seed))
    clear = np.asarray(violations(trajectory).sum(axis=0) == 0.0)
    axes = (np.asarray(axis, float).T for axis in (trajectory.x, trajectory.y, trajectory.z))
    return np.stack(list(axes), axis=2)[clear], np.asarray(trajectory.times, float).T[clear]


def _walk(
    obstacles: ap.Obstacles, coast: Coast, path: NDArray[np.floating], times: NDArray[np.floating]
) -> tuple[bool, float, float]:
    """Whether one path touches anything, m walked, and the least clearance to a boundary, m."""
    since = times[:, None] - np.asarray(obstacles.observed_at, float)
    centres = np.asarray(obstacles.position, float) + np.asarray(obstacles.velocity, float) * since[..., None]
    walk = SampledTrack.of(times, path, centres)
    away = np.linalg.norm(walk.positions[:, None] - walk.obstacles, axis=2)
    since = np.maximum(walk.times[:, None] - np.asarray(obstacles.observed_at, float), 0.0)
    grown = np.minimum(np.asarray(obstacles.growth, float) * since, np.asarray(obstacles.growth_max, float))
    boundary = np.asarray(obstacles.boundary(obstacles.observed_at), float)
    clear = float((away - boundary - grown).min())
    return clear < 0.0 or bool(coast.on_land(walk.positions).any()), float(walk.metres.sum()), clear


def said(found: Walked) -> str:
    return (
        f"{found.paths:,} of {found.drawn:,} random paths called clear, {found.metres / 1000.0:,.0f} km "
        f"walked: {found.collisions} collisions, nearest {found.nearest:.3f} m to a collision boundary"
    )


@launch(count=(COUNT, "paths to walk"))
def main(count: int) -> dict[str, Any]:
    found = walks(count)
    screen.print(said(found))
    return asdict(found)
