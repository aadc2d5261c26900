"""Planned legs against a feedback policy in currents that err: ``python -m benchmarks.feedback``.

The policy steers by the least time to reach the goal against any error of the current up to a bound, by
Hamilton-Jacobi reachability (hj_reachability) on a grid in the forecast; it knows where the vehicle is at
every moment and turns in no time. The plan is one path, made in the forecast, whose track the vehicle holds.
Both go through the same true currents: the forecast with an error made of vortices, drawn here in NumPy.
A vehicle is on time that reaches the goal within 5 % more than the plan says.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import map_coordinates

import auvplan as ap
from auvplan.ocean.currents import evaluated
from benchmarks.harness import Array, available, clock, grouped, launch, means, show, track
from benchmarks.promises import along_track, drawn_errors

#: m, side of the area, and how near the goal is near enough; m/s through the water.
SIDE, NEAR, SPEED = 3500.0, 40.0, 1.5
#: m and s: distance of grid nodes, and the steps that vehicles are followed in.
NODE, STEP = 25.0, 2.0
#: True currents of each leg.
TRUTHS = 200
#: m/s, errors of the current that the policy reckons with.
BOUNDS = 0.0, 0.1, 0.2
#: m that are kept from obstacles, and moments ahead at which what can be reached is kept.
MARGIN, TIMES = 10.0, 80
#: Share by which a vehicle may be later than planned.
LATE = 0.05

START, GOAL = np.array([300.0, 300.0, 0.0]), np.array([3200.0, 3200.0, 0.0])

#: Velocity, m/s north and east [D], of D seas at a place [D] m north and east in each.
Water = Callable[[Array, Array], tuple[Array, Array]]

COLUMNS = {
    "steered by": "{by}", "on time": "{on_time:.1%}", "time to the plan's": "{ratio:.4f}",
    "9 in 10": "{p90:.4f}", "contacts": "{contacts:.2%}", "never there": "{lost:.2%}",
    "made in": "{made:.1f} s",
}  # fmt: skip


def world(seed: int) -> ap.Environment:
    """12 vortices and 6 obstacles at rest between start and goal."""
    rng = np.random.default_rng(seed)
    current = ap.random_vortices(jax.random.key(seed), (0, 0, 0), (SIDE, SIDE, 0), count=12)
    share = np.linspace(0.2, 0.8, 6)[:, None]
    places = START + (GOAL - START) * share + rng.normal(0, 250, (6, 3)) * (1.0, 1.0, 0.0)
    obstacles = ap.Obstacles.create(places, rng.uniform(50, 150, 6))
    return ap.Environment(current, obstacles=obstacles, lower=(0, 0, 0), upper=(SIDE, SIDE, 0))


def steered(seed: int) -> list[dict[str, Any]]:
    env, vehicle = world(seed), ap.Vehicle(speed=SPEED)
    forecast = _forecast(env.current)
    rng = np.random.default_rng(90_000 + seed)
    erring = drawn_errors(rng, np.zeros(2), np.full(2, SIDE), TRUTHS)

    def truth(north: Array, east: Array) -> tuple[Array, Array]:
        u, v = forecast(north, east)
        du, dv = erring(north[:, None], east[:, None])
        return u + du, v + dv

    made, plan = clock(partial(ap.plan_path, START, GOAL, env, vehicle, key=jax.random.key(seed)))
    path, allowed = np.asarray(plan.positions)[:, :2], (1.0 + LATE) * plan.travel_time
    followed = [("plan", made, *_on_track(path, truth))]
    for bound in BOUNDS:
        made, least = clock(partial(policy, env, bound, 2.0 * plan.travel_time))
        followed.append((f"policy, errors to {bound:g} m/s", made, *_by_policy(least, truth, 3.0 * allowed)))
    balls = np.asarray(env.obstacles.position)[:, :2], np.asarray(env.obstacles.radius)
    rows = []
    for by, seconds, times, ways in followed:
        there = np.isfinite(times)
        gaps = np.linalg.norm(ways[:, :, None] - balls[0], axis=-1) - balls[1]  # [n, D, M]
        shares = times[there] / plan.travel_time
        rows.append({
            "seed": seed, "by": by, "on_time": float((times <= allowed).mean()),
            "lost": float((~there).mean()), "ratio": float(shares.mean()),
            "p90": float(np.quantile(shares, 0.9)),
            "contacts": float((gaps.min(axis=(0, 2)) < 0.0).mean()), "made": seconds,
        })  # fmt: skip
    return rows


def policy(env: ap.Environment, bound: float, horizon: float) -> Array:
    """Return the least time to the goal from each node, [N, N] s, whatever the error of the current does.

    Args:
        env: the world, its current steady.
        bound: m/s, that the current may err by against the vehicle.
        horizon: s that is looked ahead.
    """
    import hj_reachability as hj

    class Driven(hj.ControlAndDisturbanceAffineDynamics):
        """Positions under the vehicle's speed, the current and its error, in metres and seconds."""

        def open_loop_dynamics(self, state: jax.Array, time: jax.Array) -> jax.Array:
            u, v, _ = env.current(state[0], state[1], jnp.zeros(()), jnp.zeros(()))
            return jnp.stack([u, v])

        def control_jacobian(self, state: jax.Array, time: jax.Array) -> jax.Array:
            return jnp.eye(2)

        disturbance_jacobian = control_jacobian

    control, error = (hj.sets.Ball(jnp.zeros(2), size) for size in (SPEED, bound))
    driven = Driven("min", "max", control, error)
    count = round(SIDE / NODE) + 1
    box = hj.sets.Box(np.zeros(2), np.full(2, SIDE))
    grid = hj.Grid.from_lattice_parameters_and_boundary_conditions(box, (count, count))
    states = np.asarray(grid.states)
    goal = np.linalg.norm(states - GOAL[:2], axis=-1) - NEAR
    gaps = np.linalg.norm(states[:, :, None] - np.asarray(env.obstacles.position)[:, :2], axis=-1)
    inside = (np.asarray(env.obstacles.radius) + MARGIN - gaps).max(axis=-1)
    settings = hj.SolverSettings.with_accuracy(
        "high",
        hamiltonian_postprocessor=hj.solver.backwards_reachable_tube,
        value_postprocessor=hj.solver.static_obstacle(jnp.asarray(inside)),
    )
    times = np.linspace(0.0, -horizon, TIMES + 1)
    values = np.asarray(hj.solve(settings, driven, grid, times, np.maximum(goal, inside), progress_bar=False))
    reached = values <= 0.0
    first = reached.argmax(axis=0)
    rows, columns = np.indices(first.shape)
    now, before = values[first, rows, columns], values[np.maximum(first - 1, 0), rows, columns]
    share = np.where(first > 0, before / np.where(before > now, before - now, 1.0), 1.0)
    least = np.where(reached.any(axis=0), horizon / TIMES * (first - 1.0 + share), 1.5 * horizon)
    return np.maximum(least, 0.0)


def _by_policy(least: Array, truth: Water, until: float) -> tuple[Array, Array]:
    """Follow a policy in D seas: when it arrives [D] s, infinite if never, and its places [n, D, 2] m."""
    slopes = np.gradient(least, NODE)
    place = np.tile(START[:2], (TRUTHS, 1))
    times, places = np.full(TRUTHS, np.inf), [place]
    for step in range(int(until / STEP)):
        way = -np.stack(
            [map_coordinates(slope, place.T / NODE, order=1, mode="nearest") for slope in slopes], 1
        )
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        water = np.stack(truth(place[:, 0], place[:, 1]), axis=1)
        going = np.isinf(times)
        place = place + np.where(going[:, None], STEP * (SPEED * way + water), 0.0)
        places.append(place)
        times[going & (np.linalg.norm(place - GOAL[:2], axis=1) <= NEAR)] = (step + 1) * STEP
        if np.isfinite(times).all():
            break
    return times, np.stack(places)


def _on_track(path: Array, truth: Water) -> tuple[Array, Array]:
    """Follow a planned track [S, 2] m in D seas, as `_by_policy`, until the goal is near enough."""
    last = int((np.linalg.norm(path - GOAL[:2], axis=1) <= NEAR).argmax())

    def met(x: float, y: float, _: float, t: Array) -> tuple[Array, Array]:
        return truth(np.full(len(t), x), np.full(len(t), y))

    places = np.column_stack([path[: last + 1], np.zeros(last + 1)])
    times = along_track(places, SPEED, np.zeros(TRUTHS), met)
    return times, np.repeat(path[:, None], TRUTHS, axis=1)


def _forecast(current: Any) -> Water:
    """Return the forecast in NumPy, looked up on a grid five times as fine as the policy's."""
    nodes = np.arange(0.0, SIDE + 1.0, NODE / 5.0)
    north, east = (part.ravel() for part in np.meshgrid(nodes, nodes, indexing="ij"))
    zeros = np.zeros_like(north)
    fields = [
        np.asarray(part).reshape(len(nodes), -1) for part in evaluated(current, north, east, zeros, zeros)[:2]
    ]

    def met(north: Array, east: Array) -> tuple[Array, Array]:
        at = np.stack([north, east]) / (NODE / 5.0)
        u, v = (map_coordinates(part, at, order=1, mode="nearest") for part in fields)
        return u, v

    return met


@launch(legs=(range(20), "legs, by their seeds"))
def main(legs: range) -> dict[str, Any]:
    if not available("feedback policy", ["hj_reachability"]):
        return {}
    rows = [row for seed in track(legs, "legs") for row in steered(seed)]
    names = "on_time", "lost", "ratio", "p90", "contacts", "made"
    found = [{"by": by} | means(those, names) for by, those in grouped(rows, lambda row: [row["by"]]).items()]
    show(f"{len(legs)} legs in {TRUTHS} true currents each", found, COLUMNS)
    return {"means": found, "rows": rows}
