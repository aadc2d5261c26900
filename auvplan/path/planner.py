"""Two points to a timed, checked trajectory, any number of legs by the same programs (section 3.2)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.environment import Environment
from auvplan.path.config import PathConfig
from auvplan.path.ends import as_point, check_concrete, check_ends, check_given, check_moment, check_water
from auvplan.path.habitats import refitted, without_loop
from auvplan.path.plan import PathPlan, PathPlans
from auvplan.path.samples import in_samples, samples_of
from auvplan.path.sensitivity import Conditions, Given, differentiable_time
from auvplan.path.stages import Batch, Legs, polish_finely, search_legs, sketch_legs, split
from auvplan.runtime.arguments import numbers, per_row
from auvplan.runtime.budget import Budget
from auvplan.runtime.captured import captured_once
from auvplan.runtime.prng import key_per
from auvplan.runtime.rows import batch_map
from auvplan.vehicle import Vehicle

#: Share of the limits on speed over ground and current across within which a leg is searched once more: at
#: the limit no step of a polish is kept.
_INSIDE = 0.99


def plan_path(
    start: ArrayLike,
    goal: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    depart: ArrayLike = 0.0,
    population: ArrayLike | None = None,
    budget: float | None = None,
) -> PathPlan:
    """Plan the fastest safe path from start to goal.

    Under `jax.grad` and `jax.jvp` the `travel_time` of a feasible plan has a derivative by every leaf of
    start, goal, environment, vehicle and departure (envelope theorem): along the quickest path found, also
    with `SETTLING_STEPS` in the last polish, and at the limits that bind. All else in the plan is constant.

    Args:
        start: [3] m, north, east, depth.
        goal: [3] m.
        env: current, chart, obstacles, box and sea bed.
        vehicle: speed and limits; defaults to `Vehicle()`.
        key: PRNG key, consumed; the same key gives the same plan.
        config: settings; defaults to `PathConfig()`.
        depart: s since the epoch.
        population: [P, 3 n] m, habitats to start from, as in `PathPlan.population`.
        budget: s of wall-clock time, compilation left out, after which the best path so far is returned; the
            same key then gives other plans on other machines. None for all the effort of the settings.

    Returns:
        The best path found, feasible or not: see `PathPlan.feasible`, `.status` and `.reason`.

    Raises:
        ValueError: start or goal lies on land, below the sea bed, outside the chart or outside the box, the
            goal nearer to the sea bed than its clearance, or they coincide; the current is NaN on the way; or
            the departure is not finite, or too far from the epoch for single precision.
        TypeError: the key is a seed, the environment a function, the vehicle a number, a place text, the
            departure a date or `timedelta`, or the current's function cannot be traced by JAX; or the call is
            traced by `jax.jit` or `jax.vmap`.

    Example:
        >>> import jax, auvplan as ap
        >>> stream = ap.UniformCurrent(0.0, 0.5)
        >>> env = ap.Environment(stream, lower=(-500, -500, 0), upper=(2500, 1500, 0))
        >>> plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0))
        >>> plan.feasible, round(plan.travel_time)
        (True, 816)
    """
    kept = None if population is None else jnp.asarray(population)[None]

    def planned(given: Given, config: PathConfig) -> PathPlan:
        start, goal, env, vehicle, depart = given
        ends = as_point("start", start)[None], as_point("goal", goal)[None]
        settings = {"key": key, "config": config, "depart": depart, "population": kept, "budget": budget}
        return plan_paths(*ends, env, vehicle, **settings)[0]

    given, config = (start, goal, env, vehicle, depart), config or PathConfig()
    if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given)):
        return planned(given, config)
    check_given(env, vehicle, config)
    given = jax.tree.map(
        jnp.asarray,
        (jnp.asarray(start), jnp.asarray(goal), env, (vehicle or Vehicle()).without_power(), depart),
    )
    time, plan = differentiable_time(planned, given, config, "plan_path")
    return replace(plan, travel_time=time)  # type: ignore[arg-type]


def plan_paths(
    starts: ArrayLike,
    goals: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    depart: ArrayLike = 0.0,
    population: ArrayLike | None = None,
    world_per_leg: bool = False,
    budget: float | None = None,
) -> PathPlans:
    """Plan B legs by the same compiled programs, as many at once as the device does best.

    Args:
        starts: [B, 3] m, north, east, depth.
        goals: [B, 3] m.
        env: the world of all legs; with `world_per_leg` its current and obstacles carry a leading axis B.
        vehicle: speed and limits; defaults to `Vehicle()`.
        key: one PRNG key, split over the legs, or B keys; leg b's plan depends on its own key alone.
        config: settings; defaults to `PathConfig()`.
        depart: s since the epoch, one or [B].
        population: [B, P, 3 n] m, habitats to start from.
        world_per_leg: whether current and obstacles differ by leg.
        budget: s of wall-clock time for all legs together, as for `plan_path`.

    Raises:
        ValueError: as `plan_path`, naming the leg; or shapes do not fit; or keys, departures or worlds are
            not as many as legs.
        TypeError: as `plan_path`; or the call is differentiated.
    """
    check_concrete("plan_paths", (starts, goals, env, vehicle, depart, population))
    check_given(env, vehicle, config)
    check_moment("depart", depart)
    start, goal = numbers("starts", starts), numbers("goals", goals)
    if start.ndim != 2 or start.shape[1] != 3 or start.shape != goal.shape or not len(start):
        raise ValueError(
            "starts and goals must be [B, 3] m, north, east and depth, of one leg at least, "
            f"got shapes {start.shape} and {goal.shape}"
        )
    legs, conditions = start.shape[0], Conditions.of(env, vehicle, config, world_per_leg)
    watch, departs = None if budget is None else Budget(budget, legs), per_row("depart", depart, legs)
    config = conditions.config
    if population is not None:
        shape = (legs, config.bbo.population, 3 * config.control_points)
        if np.shape(population) != shape:
            raise ValueError(
                f"population must be [B, P, 3 n], {shape} here, got shape {np.shape(population)}"
            )
    search = partial(in_samples, search_legs)
    keys = key_per("leg", key, legs)
    return search_and_polish(search, population, (start, goal), departs, keys, conditions, watch)


@captured_once()
def search_and_polish(
    search: Callable[..., dict[str, Any]],
    population: Any,
    ends: tuple[NDArray[np.floating], NDArray[np.floating]],
    depart: NDArray[np.floating],
    keys: jax.Array,
    conditions: Conditions,
    budget: Budget | None,
) -> PathPlans:
    """Plan B legs by a search, and polish what it leaves wanting.

    Args:
        search: such as `search_legs`.
        population: what it begins with, by leg.
        ends: starts and goals, [B, 3] m.
        depart: [B] s since the epoch.
        keys: [B] PRNG keys.
        conditions: what paths are planned for.
        budget: for all of it.

    Raises:
        ValueError: as `plan_paths`.
    """
    env, vehicle, per_leg = conditions.env, conditions.vehicle, conditions.leg is not None
    own, shared = split(env, len(depart) if per_leg else None)
    check_ends(*ends, env, vehicle)
    since, known = None, vehicle.navigation
    if known is not None:
        since = np.broadcast_to(known.way, len(depart)), np.broadcast_to(known.unlocked, len(depart))
        vehicle = replace(vehicle, navigation=known.fixed())
    batch = Batch.of(Legs(*ends, depart, own, since), shared, vehicle, conditions.config)
    program = partial(search, config=conditions.config, budget=budget)
    found = _by_legs(program, keys, batch, population)
    found, finer = plan_finely(found, keys, batch, conditions.config, budget)
    if not per_leg:
        check_water(found["water"], found["positions"], found["times"], ends, env)
    return PathPlans(**found, conditions=conditions, finer=finer)


@captured_once()
def sketch_paths(
    starts: NDArray[np.floating],
    goals: NDArray[np.floating],
    departs: NDArray[np.floating],
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    world_per_leg: bool = False,
) -> NDArray[np.floating]:
    """Polish the best passages of B legs and no more: paths nearly as quick as those of `plan_paths`.

    They need not keep every limit.

    Args:
        starts, goals: [B, 3] m.
        departs: [B] s since the epoch.
        env: the world; with `world_per_leg` its current and obstacles carry a leading axis B.
        vehicle: speed and limits.
        config: settings.
        world_per_leg: whether the world differs by leg.

    Returns:
        Paths [B, 2, S, 3] m, with `config.samples` samples S. Where the current changes with depth the first
        takes depths of its own, the second about those of the straight line.
    """
    world, shared = split(env, len(starts) if world_per_leg else None)
    batch = Batch.of(Legs(starts, goals, departs, world), shared, vehicle, config)

    def sketch(legs: Legs) -> NDArray[np.floating]:
        own = batch.of_legs(legs)
        samples = samples_of(own) if config.sampled else None
        return sketch_legs(
            own if samples is None else own.within(replace(shared, current=samples[0])), config
        )

    return batch_map(sketch, batch.legs)


def _by_legs(program: Callable[..., Any], keys: jax.Array, batch: Batch, rows: Any) -> dict[str, Any]:
    """Run a program on the legs of a batch with their keys and rows, by `batch_map`."""
    return batch_map(
        lambda keys, legs, rows: program(keys, batch.of_legs(legs), rows), keys, batch.legs, rows
    )


def plan_finely(
    found: dict[str, Any],
    keys: jax.Array,
    batch: Batch,
    config: PathConfig,
    budget: Budget | None = None,
) -> tuple[dict[str, Any], dict[int, dict[str, Any]]]:
    """Polish paths with more control points and samples where those found leave something wanting.

    Winding ways have more bends than the usual control points can follow, and narrow ones are certified only
    between samples that lie close together. Where a path still breaks a limit although a way is open, the leg
    is searched once more inside the limits on speed over ground and current across. A path that crosses
    itself is polished without its loop, twice where that leaves it over a limit.

    Args:
        found: fields of `PathPlans` by name, and `wanting` and `unsettled`, which are taken out.
        keys: [B].
        batch: B legs.
        config: settings.
        budget: that this keeps to as a whole, from how long it took for one leg before.

    Returns:
        The fields, with better paths where there are any, seen at every `finer`-th sample; and by index of
        the leg the fields of these paths at all samples.
    """
    wanting, unsettled = found.pop("wanting"), found.pop("unsettled")
    finer: dict[int, dict[str, Any]] = {}

    def polished(
        found: dict[str, Any], chosen: Any, rows: Any, again: bool, rounds: int = 1
    ) -> tuple[dict, dict]:
        program = partial(in_samples, polish_finely, config=config, again=again)

        def polish(which: NDArray[np.int_], rows: NDArray[np.floating]) -> dict[str, Any]:
            return _by_legs(program, keys[which], batch.of_legs(_rows_of(batch.legs, which)), rows)

        improve = partial(_improved, found, chosen, rows, polish, batch.legs, config, rounds)
        if budget is None:
            return improve()
        share, work = budget.rest(), ("polish", config, again, len(chosen))
        return share.spend(work, improve) if share.allows(work) else (found, {})

    if config.finer == 1 and not config.passages:
        return found, finer
    kinds = [(wanting, True), (unsettled & ~wanting, False)]
    if config.finer == 1:  # nothing is finer: what breaks a limit is mended
        kinds = [(wanting & found["violations"].any(axis=1), False)]
    for chosen, again in kinds:
        if chosen.any():
            known = found["population"][chosen, 0]
            found, new = polished(found, np.flatnonzero(chosen), known, again=again)
            finer |= new
    broken = np.flatnonzero(wanting & (found["closed"] == 0.0) & found["violations"].any(axis=1))
    if broken.size and budget is None:
        inside = batch.vehicle.stricter(_INSIDE, "surge_max", "sway_max")
        posed = replace(batch, legs=_rows_of(batch.legs, broken), vehicle=inside)
        search = partial(in_samples, search_legs, config=config)
        rows = _by_legs(search, keys[broken], posed, None)["population"][:, 0]
        found, new = polished(found, broken, rows, again=False)
        finer |= new
    paths = enumerate(found["positions"])
    cut = {leg: row for leg, path in paths if (row := without_loop(path, config)) is not None}
    if cut:
        rows = np.stack(list(cut.values()))
        found, new = polished(found, np.array(list(cut)), rows, again=False, rounds=2)
        finer |= new
    return found, finer


def _improved(
    found: dict[str, Any],
    chosen: NDArray[np.int_],
    rows: NDArray[np.floating],
    polish: Callable[[NDArray[np.int_], NDArray[np.floating]], dict[str, Any]],
    legs: Legs,
    config: PathConfig,
    rounds: int,
) -> tuple[dict[str, Any], dict[int, dict[str, Any]]]:
    """As `plan_finely`, by a polish of the legs chosen, from a habitat, [3 n] m, of each.

    Where what it made breaks a limit it goes on from there, `rounds` in all.
    """
    posed, old = _rows_of((legs, found), chosen)
    new = polish(chosen, rows)
    for _ in range(rounds - 1):
        left = np.flatnonzero(new["violations"].any(axis=1))
        if not left.size:
            break
        own, made = _rows_of((posed, new["population"]), left)
        rows = refitted(made, own.start, own.goal, config.fine(), config)[:, 0]
        new = jax.tree.map(partial(_replaced, rows=left), new, polish(chosen[left], rows))
    del new["wanting"]
    broken = [plans["violations"].sum(axis=1) for plans in (new, old)]
    quicker = (broken[0] == 0.0) & (broken[1] == 0.0) & (new["cost"] < old["cost"])
    less = (broken[0] < broken[1]) | quicker
    if not less.any():
        return found, {}
    best = refitted(new["population"], posed.start, posed.goal, config.fine(), config)
    new["population"] = np.concatenate([best, old["population"][:, :-1]], axis=1)
    new["history"] = old["history"]
    new, better = _rows_of(new, less), chosen[less]
    finer = {int(leg): jax.tree.map(lambda leaf, k=k: leaf[k], new) for k, leg in enumerate(better)}
    return jax.tree.map(partial(_replaced, rows=better), found, new | _thinned(new, config)), finer


def _rows_of(tree: Any, rows: NDArray[Any]) -> Any:
    """Return these rows of all arrays."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[rows], tree)


def _replaced(plane: Any, by: Any, rows: NDArray[np.int_]) -> Any:
    """Return an array with these rows of its own by those of another one."""
    plane = np.array(plane)
    plane[rows] = by
    return plane


def _thinned(found: dict[str, Any], config: PathConfig) -> dict[str, Any]:
    """Return what paths of `config.fine()` are like at the usual samples and control points."""
    times, free = config.finer, config.control_points
    excess, water = found["excess"], found["water"]
    inner = found["population"][:, 0].reshape(-1, 3, free).swapaxes(1, 2)
    ends = found["control_points"][:, :1], found["control_points"][:, -1:]
    return {
        "positions": found["positions"][:, ::times],
        "times": found["times"][:, ::times],
        "control_points": np.concatenate([ends[0], inner, ends[1]], axis=1),
        "excess": excess.reshape(*excess.shape[:2], -1, times).max(axis=3),
        "water": water.reshape(len(water), -1, times, 3).mean(axis=2),
    }
