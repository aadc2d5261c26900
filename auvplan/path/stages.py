"""The search for paths between two points, as a few compiled programs one after the other (section 3.2).

Each program depends on no more settings and shapes than it uses. So a first plan and those that replace it on
the way share all of them, and the costly part of each, the kernel with its gradient, is compiled once.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.bbo import search
from auvplan.bbo.refine import descend
from auvplan.ocean.currents import Current, combine, is_quasi_steady, partition
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.vortices import padded, rounded_up
from auvplan.path import habitats
from auvplan.path.bspline import basis_matrix
from auvplan.path.config import PathConfig
from auvplan.path.cost import (
    SOFTNESS,
    VIOLATIONS,
    Trajectory,
    cost_of,
    evaluate,
    judged_within,
    score,
    soft_objective,
    timed_at_places,
    toll,
    tracks,
    violations,
)
from auvplan.path.ends import check_worlds
from auvplan.path.kinematics import PacedCurrent, norm, vertical_speeds
from auvplan.path.passages import trace_passages
from auvplan.path.problem import WAY, Problem, factor_of, scaled
from auvplan.path.profile import compared, is_searched_in_depth, timed
from auvplan.runtime import prng
from auvplan.runtime.budget import UNLIMITED, Budget, Share, Unlimited, share_of
from auvplan.runtime.compiled import compiled
from auvplan.runtime.pytree import row_kinds
from auvplan.runtime.rows import over_rows
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle

#: Current (or None, where all of it is shared) and obstacles; None where the legs share both.
World = tuple[Current | None, Obstacles] | None

#: Paths of a leg are taken to make at least this share of the speed through the water over ground.
_SLOWEST = 0.3

#: Share of a time that sweeps may miss, see `_pace`, where times of paths that are compared are settled so;
#: else these are timed segment by segment.
_MISSED = 1e-3

#: Passages of denser fields that are polished with fine settings.
_FEW = 2

#: Times of the straight line in still water from which a path is a long detour: a nearer passage may be
#: narrower than a cell.
_ROUNDABOUT = 1.5

#: Share by which a path in depth may be slower than one that the fields know before denser ones are laid out:
#: these know less of the moves between depths, and a finer polish makes up for what is within it.
_KNOWN_IN_DEPTH = 0.05

#: Factor on the steps of a descent in depth, as shares of the bounds, over those in the plane: bounds in the
#: plane are wider than the leg, and profiles move through a good part of the box's depth.
_DEEPER = 4.0

#: Where the current is sheared, a path that takes more than a share of the limits in the vertical is polished
#: once more: on slopes at their limit larger steps break it, and none of them is kept. The share; then shares
#: of the penalties' weights and of the step, and times as many steps.
_NEARLY, _STEEP = 0.8, (0.03, 0.25, 2)

#: Share of `PathConfig.settled` up to which a path in depth has settled: profiles have more bends than ways.
_SETTLED_IN_DEPTH = 0.1

#: A path that breaks a limit after that is polished with the first of these shares of the penalties' weights,
#: against limits of the vehicle that are lower by the second factor: from where the last polish left it, or
#: from the start, since soft weights let it cross what it cannot leave again. Where the first of them did not
#: mend it, that from the start may find a quicker path. The last has room for what the middle of a segment
#: hides.
_STRICTER = (0.1, 0.99, False), (0.1, 0.98, False), (1.0, 0.98, False), (1.0, 0.99, True), (0.1, 0.9, False)


def split(env: Environment, legs: int | None) -> tuple[World, Environment]:
    """Return what differs by leg where worlds do, one for each of `legs`, and what is the same for all."""
    if legs is not None:
        check_worlds(legs, "leg", current=partition(env.current)[1], obstacles=env.obstacles)
    obstacles = env.obstacles.padded(rounded_up(env.obstacles.radius.shape[-1]))
    env = replace(env, current=padded(env.current), obstacles=obstacles)
    if legs is None:
        return None, env
    current, own = partition(env.current)
    return (own, env.obstacles), replace(env, current=current, obstacles=Obstacles.none())


def world_of(own: World, shared: Environment) -> Environment:
    """Return the world of one leg, obstacles resolved."""
    if own is None:
        current, obstacles = shared.current, shared.obstacles
    else:
        current, obstacles = combine(shared.current, own[0]), own[1]
    resolved = obstacles.resolved(current)
    return replace(shared, current=current, obstacles=resolved)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Legs:
    """B legs that paths are searched for.

    Attributes:
        start, goal: [B, 3] m.
        depart: [B] s since the epoch.
        own: what of the world differs by leg.
        since: way and time out of bottom lock since the vehicle's last fix, [B] m and s; None where there is
            no navigation, or it is the vehicle's own.
    """

    start: Any
    goal: Any
    depart: Any
    own: World
    since: tuple[Any, Any] | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Batch:
    """B legs and what they share, apart from what programs are compiled for: what all programs take.

    Attributes:
        legs: B legs.
        env: the part of the world that is the same for all legs.
        vehicle: speed and limits.
        numbers: margins and price of the settings.
    """

    legs: Legs
    env: Environment
    vehicle: Vehicle
    numbers: dict[str, Any]

    @classmethod
    def of(cls, legs: Legs, env: Environment, vehicle: Vehicle, config: PathConfig) -> "Batch":
        """Return a batch with the margins and the price of some settings."""
        return cls(legs, env, vehicle, config.numbers)

    def of_legs(self, legs: Legs) -> "Batch":
        """Return a batch of other legs."""
        return replace(self, legs=legs)

    def within(self, env: Environment) -> "Batch":
        """Return the same legs with another world in common."""
        return replace(self, env=env)

    @property
    def current(self) -> Current:
        """The current of one leg, as far as its kind goes."""
        own = self.legs.own
        return self.env.current if own is None else combine(self.env.current, row_kinds(own[0]))

    @property
    def is_deep(self) -> bool:
        """Whether paths may find other currents at other depths."""
        return is_searched_in_depth(self.env, self.vehicle, self.current)

    @property
    def winding(self) -> np.ndarray:
        """[B], whether the straight line is too steep for the vehicle."""
        way = np.asarray(self.legs.goal) - np.asarray(self.legs.start)
        return np.abs(way[:, 2]) > self.vehicle.steepest(way[:, 2]) * np.linalg.norm(way, axis=1) + 1e-6

    @property
    def factors(self) -> np.ndarray:
        """[B, 1], by which lengths and times of each leg are scaled in the search."""
        legs = self.legs
        return np.array([factor_of(*ends) for ends in zip(legs.start, legs.goal, strict=True)])[:, None]

    def step_sizes(self, first: float, config: PathConfig) -> np.ndarray | np.float32:
        """First step of a descent as shares of the bounds, [3 n] where depth is searched, else []."""
        if not self.is_deep:
            return np.float32(first)
        return np.repeat(np.asarray([first, first, _DEEPER * first], np.float32), config.control_points)

    def over_legs(self, one: Callable[..., Any], *rows: Any) -> Any:
        """Call a function of a leg, and of its row of the other arguments, for all legs; for traced code."""
        return over_rows(one)(self.legs, *rows)

    def problem(self, leg: Legs) -> Problem:
        """Return one leg."""
        vehicle = self.vehicle
        if leg.since is not None and vehicle.navigation is not None:
            vehicle = replace(vehicle, navigation=vehicle.navigation.since(*leg.since))
        return Problem(leg.start, leg.goal, leg.depart, world_of(leg.own, self.env), vehicle)

    def posed(self, leg: Legs, config: PathConfig) -> tuple[Problem, PathConfig, jax.Array]:
        """Return one leg as the search sees it, its settings, and by what factor both are scaled."""
        return scaled(self.problem(leg), config.replace(**self.numbers))

    def compared(self, leg: Legs, pace: jax.Array | None, config: PathConfig) -> tuple[Problem, PathConfig]:
        """Return one leg as `posed`, in the world that paths are compared in."""
        problem, config, _ = self.posed(leg, config)
        if pace is not None:
            env = replace(problem.env, current=PacedCurrent(problem.env.current, pace))
            problem = replace(problem, env=env)
        return problem, config


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Bounds:
    """Where habitats of B legs may lie, and how fast paths are followed while they are compared.

    Attributes:
        lower, upper: [B, 3 n] m.
        pace: [B, S - 1] m/s over ground, see `_pace`, or None.
    """

    lower: Any
    upper: Any
    pace: Any


def search_legs(
    keys: jax.Array,
    batch: Batch,
    population: Any,
    config: PathConfig,
    window: bool = False,
    budget: Budget | None = None,
    judging: Batch | None = None,
) -> dict[str, Any]:
    """Search for the paths of B legs: the fields of `PathPlans` by name, `wanting` and `unsettled`.

    Args:
        keys: [B] PRNG keys, consumed.
        batch: B legs, in the world that paths are searched for in.
        population: [B, P, 3 n] m, habitats to start from, or None.
        config: settings.
        window: whether to make the effort of one window alone (`PathConfig.window`), from the population of
            a path in hand, the best first, whose rest is bent round what has come.
        budget: of which this takes one row's share; what does not fit into it is left out.
        judging: the legs in the world that paths are judged in, where it is another one.

    Returns:
        Arrays with a leading axis B. `wanting` is set where the path found breaks a limit although the
        fields find a passage open, makes a long detour, or is slower than one that they know; `unsettled`
        where the last polish still improved it.
    """
    judging = judging or batch
    places, config = timed(config, judging.current).quadrature, compared(config, batch.env, batch.current)
    effort, share = config.window() if window else config, share_of(budget)
    run = _Run(batch, config, share, (config, jax.tree.structure(batch), len(batch.legs.start)))
    share.keep_for(run.work("finish"), run.work("begin"), run.work("evolve"))
    found = None
    if config.passages and share.allows(run.work("trace")):
        cells = config.only("field_cells")
        trace = partial(_trace, batch, config=cells, count=config.passages, deep=batch.is_deep)
        passages, _, *known = share.spend(run.work("trace"), trace)
        found = passages, *known
    elif config.passages:
        found = _no_passages(batch, config)
    begin = partial(_begun, batch, keys, population, found, config, config.bbo.population, effort.passages)
    first_rows, bounds = share.spend(run.work("begin"), begin)
    population = np.asarray(first_rows)
    if (count := effort.passages) and effort.passage_steps:
        # All passages at first, then the better half of them: a few steps show which ones lead nowhere.
        first, step_size = effort.passage_steps // 3, config.refine_step_size
        rows = _ranked(*run.descended(bounds, population[:, -count:], first, step_size))[0]
        half = -(-count // 2)
        better = run.descended(bounds, rows[:, :half], effort.passage_steps - first, step_size)[0]
        population = np.concatenate([population[:, :-count], better, rows[:, half:]], axis=1)
        if window:
            # The rest of the path in hand, bent round what has come.
            bent = run.descended(bounds, population[:, :1], config.passage_steps, step_size)[0]
            population = np.concatenate([bent, population[:, 1:]], axis=1)

    state, history = run.evolved(bounds, keys, population, effort.bbo.iterations)
    before, polished = np.asarray(history.best)[:, -1], None
    if effort.refine_steps:
        planes = (state.population, state.cost, state.violation)
        rows, *scores = (np.asarray(plane)[:, : config.refine_count] for plane in planes)
        step_size = config.refine_step_size / 3.0
        polished = run.descended(bounds, rows, effort.refine_steps, step_size, scores=scores)
    known, slack = None if found is None else found[2:], np.float32(_KNOWN_IN_DEPTH * batch.is_deep)
    finish = partial(_finish, judging, state, polished, known, slack)
    plans, last = share.spend(run.work("finish"), partial(finish, config=config.only(), places=places))
    plans, last = jax.device_get((plans, last))
    settled = config.settled * (_SETTLED_IN_DEPTH if batch.is_deep else 1.0)
    # Segments that hide some of the current that they cross are too long.
    unsettled = plans.pop("slower") | (plans.pop("hidden") > settled * plans["travel_time"])
    if polished is not None:
        unsettled |= last.best < (1.0 - settled) * before
        history = jax.tree.map(lambda rows, end: np.concatenate([rows, end[:, None]], axis=1), history, last)
    return plans | {"history": history, "unsettled": unsettled}


def sketch_legs(batch: Batch, config: PathConfig) -> np.ndarray:
    """Polish the best passages of B legs and no more: paths [B, 2, S, 3] m, nearly as quick as the search's.

    The first is the best of those at depths of their own where the current changes with depth.

    Args:
        batch, config: as for `search_legs`.
    """
    legs = batch.legs
    keys = jax.random.split(jax.random.key(0), len(legs.start))
    config = compared(config, batch.env, batch.current)
    cells = config.only("field_cells")
    count, deep = max(config.passages, 2), batch.is_deep
    rows, _, times, *_ = _trace(batch, config=cells, count=count, deep=deep)
    # Each kind of passages begins with its best.
    best = [0, count - count // 2 if deep else 1]
    found = tuple(np.asarray(plane)[:, best] for plane in (rows, times))
    rows, bounds = _begun(batch, keys, None, found, config, 2, 2)
    effort = config.passage_steps + config.refine_steps, config.refine_step_size
    rows = _Run(batch, config).descended(bounds, np.asarray(rows), *effort)[0]
    free = (rows / batch.factors[:, :, None]).reshape(*rows.shape[:2], 3, -1).swapaxes(2, 3)
    ends = [np.broadcast_to(end[:, None, None], (*free.shape[:2], 1, 3)) for end in (legs.start, legs.goal)]
    polygons = np.concatenate([ends[0], free, ends[1]], axis=2)
    return basis_matrix(config.samples, polygons.shape[2], config.degree) @ polygons


def _no_passages(batch: Batch, config: PathConfig) -> tuple[np.ndarray, ...]:
    """Return what `_trace` returns where there is no passage, as far as the search uses it."""
    start, goal = (np.asarray(end) * batch.factors for end in (batch.legs.start, batch.legs.goal))
    part = np.linspace(0.0, 1.0, config.control_points + 2)[1:-1]
    line = (start[:, :, None] + (goal - start)[:, :, None] * part).reshape(len(start), 1, -1)
    shape = len(start), config.passages
    lines = np.broadcast_to(line, (*shape, line.shape[2])).astype(np.float32)
    none = np.zeros(len(start), np.float32)
    return lines, np.full(shape, np.inf, np.float32), none, none + np.inf


@dataclass(frozen=True)
class _Run:
    """A search under way, whose longer parts are cut to the time that there is.

    Attributes:
        batch: B legs, in the world that paths are searched for in.
        config: settings.
        share: of a budget.
        of: what the time of a piece of work depends on.
    """

    batch: Batch
    config: PathConfig
    share: Share | Unlimited = UNLIMITED
    of: tuple = ()

    def work(self, name: str) -> tuple:
        """Return what a piece of work is timed by."""
        return name, *self.of

    def evolved(
        self, bounds: Bounds, keys: jax.Array, population: np.ndarray, most: int
    ) -> tuple[search.State, search.History]:
        """States and histories of as many of `most` iterations as the time allows.

        None is enough for a score.
        """
        done, parts, settings, work = 0, [], self.config.only("bbo"), self.work("evolve")
        while done < most or not parts:
            chunk = self.share.units(work, most - done)
            if not chunk and parts:
                break
            own = self.batch, keys if not done else prng.folded_rows(keys, done), population, bounds
            evolve = partial(_evolve, *own, np.int32(chunk), config=settings)
            state, history = self.share.spend(work, evolve, chunk + 1)
            population, done = state.population, done + chunk
            parts.append(search.rows(history, slice(1 if parts else 0, chunk + 1)))
            if not chunk:
                break
        return state, search.joined(parts, most - done)

    def descended(
        self,
        bounds: Bounds,
        rows: np.ndarray,
        steps: int,
        step_size: float,
        softness: float = SOFTNESS,
        scores: list[np.ndarray] | None = None,
    ) -> tuple[np.ndarray, ...]:
        """Rows [B, R, 3 n] polished by gradients, their costs and violations [B, R].

        `refine_count` at a time, as far as the time allows, in chunks of ever smaller steps. Rows that none
        was left for are as they were, with the scores given, or the worst.
        """
        at_once, out, work = self.config.refine_count, [np.array(rows)], self.work("descend")
        out += [np.array(plane) for plane in scores or [np.full(rows.shape[:2], np.inf, np.float32)] * 2]
        groups = [slice(begin, begin + at_once) for begin in range(0, rows.shape[1], at_once)]
        done = 0
        while done < steps:
            chunk = self.share.units(work, steps - done)
            for group in groups:
                if not (chunk and self.share.units(work, 1)):
                    return tuple(out)
                part = out[0][:, group]
                real = part.shape[1]
                padded = np.concatenate([part, np.repeat(part[:, -1:], at_once - real, axis=1)], axis=1)
                size = 0.5 * step_size * (1.0 + np.cos(np.pi * done / steps))
                numbers = np.int32(chunk), self.batch.step_sizes(size, self.config), np.float32(softness)
                descend = partial(_descend, self.batch, padded, bounds, *numbers, config=self.config.only())
                better = self.share.spend(work, descend, chunk + 1)
                for plane, new in zip(out, better, strict=True):
                    plane[:, group] = np.asarray(new)[:, :real]
            done += chunk
        return tuple(out)


def polish_finely(
    keys: jax.Array,
    batch: Batch,
    known: np.ndarray,
    config: PathConfig,
    again: bool,
    judging: Batch | None = None,
) -> dict[str, Any]:
    """Polish the paths of B legs with the control points and samples of `config.fine()`.

    Args:
        keys: [B] PRNG keys, consumed.
        batch, judging: as for `search_legs`.
        known: [B, 3 n] m, a path of each.
        config: settings.
        again: whether to look for passages in denser fields too, and to polish the best of them.

    Returns:
        As `search_legs` but for the history; populations hold the best path alone.
    """
    judging, legs, vehicle = judging or batch, batch.legs, batch.vehicle
    places, config = timed(config, judging.current).quadrature, compared(config, batch.env, batch.current)
    fine, deep, factors = config.fine(), batch.is_deep, batch.factors
    ends = legs.start * factors, legs.goal * factors
    rows, outcome = (known * factors)[:, None].astype(np.float32), None
    polished = partial(_polished, keys, batch)
    if again:
        dense = config.only("finer").replace(field_cells=config.dense_cells)
        passages, few, _, *outcome = _trace(batch, config=dense, count=config.passages, deep=deep)
        rows = np.concatenate([rows, passages], axis=1)
        settings = config.replace(refine_steps=config.passage_steps)
        rows = _ranked(*polished(rows, settings, together=rows.shape[1]))[0][:, :1]
    rows = habitats.refitted(rows, *ends, config, fine)
    if again:
        rows = np.concatenate([rows, few[:, :_FEW]], axis=1)
        if batch.winding.any():  # with a path that winds within the limits, the last of them
            winding = np.where(_over(batch.winding, few[:, -1:]), few[:, -1:], few[:, :1])
            rows = np.concatenate([rows, winding], axis=1)

    def judged(rows: np.ndarray, costs: np.ndarray, broken: np.ndarray) -> dict[str, Any]:
        """Return the first rows as fields of `PathPlans`."""
        state = search.State(*(jnp.asarray(plane[:, :1]) for plane in (rows, costs, broken)))
        found = _finish(judging, state, None, outcome, np.float32(0.0), config=fine.only(), places=places)
        plans = jax.device_get(found[0])
        del plans["hidden"], plans["slower"]
        return plans

    ranked = _ranked(*polished(rows, fine))
    best, last = judged(*ranked), ranked[0]
    if deep and (steep := _steepest(best, vehicle, config) > _NEARLY).any():
        softness, less, times = _STEEP
        steps, size = times * fine.refine_steps, less * fine.refine_step_size
        gentle = fine.replace(refine_steps=steps, refine_step_size=size)
        first = polished(last[:, :1], gentle, softness=softness)
        first = [np.where(_over(steep, new), new, old[:, :1]) for new, old in zip(first, ranked, strict=True)]
        last = np.concatenate([first[0], last[:, 1:]], axis=1)
        best = judged(*first)
    tried = np.zeros(len(rows), int)
    for softness, lower, restart in _STRICTER:
        wanted = best["violations"].any(axis=1) | (restart & (tried > 1))
        if not wanted.any():
            continue
        stricter = vehicle.stricter(
            lower, "surge_max", "sway_max", "turn_rate_max", *VERTICAL_LIMITS.values()
        )
        strict = replace(batch, vehicle=stricter)
        ranked = _ranked(*_polished(keys, strict, rows if restart else last, fine, softness))
        last, more, tried = ranked[0], judged(*ranked), tried + wanted
        excess, known = (plans["violations"].sum(axis=1) for plans in (more, best))
        better = wanted & ((excess < known) | ((excess == known) & (more["cost"] < best["cost"])))
        best = jax.tree.map(
            lambda new, old, better=better: np.where(_over(better, new), new, old), more, best
        )
    return best


def _steepest(plans: dict[str, Any], vehicle: Vehicle, config: PathConfig) -> np.ndarray:
    """Return the greatest share that paths take of the limits in the vertical, [B]; zero without a limit."""
    places, water = (np.moveaxis(np.asarray(plans[name], float), -1, 0) for name in ("positions", "water"))
    way = np.diff(places, axis=-1)
    # Samples may coincide, and are then passed at once: such a segment is level.
    gap, lasts = np.linalg.norm(way, axis=0), np.diff(np.asarray(plans["times"], float), axis=-1)
    ground = np.divide(gap, lasts, out=np.zeros_like(gap), where=lasts > 0.0)
    gap = np.where(gap > 0.0, gap, 1.0)
    speeds = vertical_speeds(tuple(water), tuple(way), gap, ground, vehicle, config.speed_reading)  # type: ignore[arg-type]
    shares = [speed.max(axis=1) / np.asarray(limit) for speed, limit in speeds.values()]
    return np.max([np.zeros(len(gap)), *shares], axis=0)


def _over(chosen: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return what is chosen of B legs, [B], with as many axes as a plane that has B rows."""
    return chosen.reshape(-1, *(1,) * (plane.ndim - 1))


def _polished(
    keys: jax.Array,
    batch: Batch,
    rows: np.ndarray,
    config: PathConfig,
    softness: float = SOFTNESS,
    together: int = 1,
) -> tuple[np.ndarray, ...]:
    """Rows [B, R, 3 n], as the search sees them, polished by `_Run.descended` within the same bounds."""
    parts = []
    for begin in range(0, rows.shape[1], together):
        part = rows[:, begin : begin + together]
        found = part, np.zeros(part.shape[:2], part.dtype)
        part, bounds = _begun(batch, keys, None, found, config, together, together)
        effort = config.refine_steps, config.refine_step_size
        parts.append(_Run(batch, config).descended(bounds, np.asarray(part), *effort, softness))
    return tuple(np.concatenate(planes, axis=1) for planes in zip(*parts, strict=True))


def _ranked(rows: np.ndarray, costs: np.ndarray, violations: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows [B, R, 3 n], costs and violations [B, R], the least cost first."""
    order = np.argsort(costs, axis=1, kind="stable")
    rows = np.take_along_axis(rows, order[:, :, None], axis=1)
    return rows, *(np.take_along_axis(plane, order, axis=1) for plane in (costs, violations))


@partial(compiled, static_argnames=("config", "count", "deep"), wide=True, quick=True)
def _trace(batch: Batch, config: PathConfig, count: int, deep: bool) -> tuple[jax.Array, ...]:
    """Paths through passages, as `trace_passages` returns them."""

    def one(leg: Legs) -> tuple[jax.Array, ...]:
        problem, own, _ = batch.posed(leg, config)
        return trace_passages(problem, count, own, deep)

    return batch.over_legs(one)


def _begun(
    batch: Batch,
    keys: jax.Array,
    populations: Any,
    found: tuple[Any, ...] | None,
    config: PathConfig,
    size: int,
    count: int,
) -> tuple[jax.Array, Bounds]:
    """Call `_begin` with what it takes of a search's settings."""
    fresh = config.only("start_shape", "width", "depth_width")
    settings = {"config": fresh, "size": size, "count": count}
    population, bounds, missed = _begin(batch, keys, populations, found, **settings)
    if bounds.pace is not None and not (np.asarray(missed) < _MISSED).all():
        bounds = replace(bounds, pace=None)
    return population, bounds


@partial(compiled, static_argnames=("config", "size", "count"), wide=True, quick=True)
def _begin(
    batch: Batch,
    keys: jax.Array,
    populations: jax.Array | None,
    found: tuple[jax.Array, ...] | None,
    config: PathConfig,
    size: int,
    count: int,
) -> tuple[jax.Array, Bounds, jax.Array]:
    """Populations [B, size, 3 n] with the best `count` paths found, their bounds, and what `_pace` misses."""

    def one(
        leg: Legs, key: jax.Array, population: jax.Array | None, found: tuple[jax.Array, ...] | None
    ) -> tuple[jax.Array, Bounds, jax.Array]:
        problem, own, factor = batch.posed(leg, config)
        lower, upper = habitats.bounds(problem, own)
        if population is None:
            population = habitats.initial(_keys(key)[0], size, problem, lower, upper, own)
        else:
            population = population * factor
        if found is not None:
            passages, exist = found[0][:count], jnp.isfinite(found[1][:count])
            lower, upper = habitats.widened(lower, upper, passages, problem.env)
            through = jnp.where(exist[:, None], passages, population[-count:])
            population = population.at[-count:].set(through)
        pace, missed = None, jnp.zeros(())
        if is_quasi_steady(problem.env.current):
            pace, missed = _pace(problem, own, population[-count:] if count else population[:1])
        return jnp.clip(population, lower, upper), Bounds(lower, upper, pace), missed

    return batch.over_legs(one, keys, populations, found)


def _keys(key: jax.Array) -> jax.Array:
    """Keys of a leg's first population and of its evolution."""
    return jax.random.split(key)


def _pace(problem: Problem, config: PathConfig, likely: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return the pace [S - 1] of the straight line, m/s over ground, and what sweeps from still water miss.

    That is the greatest share of the time of the line and of likely paths, habitats [R, 3 n]: how well
    `PacedCurrent` serves here.
    """
    line = habitats.straight_line(*problem.ends, config)[None]
    paths = tracks(jnp.concatenate([line, likely]), problem, config)
    bare = replace(problem.env, chart=None, obstacles=Obstacles.none(), seabed=None, closures=())
    gap, speed = norm(*paths.way), problem.vehicle.speed
    still = PacedCurrent(bare.current, jnp.broadcast_to(speed, gap.shape[:1]))
    worlds = bare, replace(bare, current=still)
    exact, swept = (evaluate(paths, problem.depart, env, problem.vehicle, config) for env in worlds)
    pace = jnp.maximum(gap[:, 0] / jnp.diff(exact.times[:, 0]), _SLOWEST * speed)
    return pace, jnp.abs(swept.travel_time / exact.travel_time - 1.0).max()


@partial(compiled, static_argnames=("config",), wide=True)
def _descend(
    batch: Batch,
    rows: jax.Array,
    bounds: Bounds,
    steps: jax.Array,
    step_size: jax.Array,
    softness: jax.Array,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Rows [B, R, 3 n] polished by gradients, their costs and violations [B, R]."""

    def one(leg: Legs, rows: jax.Array, bounds: Bounds) -> tuple[jax.Array, jax.Array, jax.Array]:
        problem, own = batch.compared(leg, bounds.pace, config)
        guide = partial(soft_objective, config=own, softness=softness)
        return descend(guide, rows, bounds.lower, bounds.upper, steps, (problem,), step_size)

    return batch.over_legs(one, rows, bounds)


@partial(compiled, static_argnames=("config",), wide=True)
def _evolve(
    batch: Batch,
    keys: jax.Array,
    populations: jax.Array,
    bounds: Bounds,
    iterations: jax.Array,
    config: PathConfig,
) -> tuple[search.State, search.History]:
    """Last populations and histories; rows of a history after the iterations that were run are not set."""

    def one(
        leg: Legs, key: jax.Array, population: jax.Array, bounds: Bounds
    ) -> tuple[search.State, search.History]:
        problem, own = batch.compared(leg, bounds.pace, config)
        cost, limits = partial(score, config=own), (bounds.lower, bounds.upper)
        result = search.run(
            _keys(key)[1], cost, population, *limits, config.bbo, (problem,), iterations=iterations
        )
        return result.state, _in_seconds(result.history, leg)

    return batch.over_legs(one, keys, populations, bounds)


@partial(compiled, static_argnames=("config", "places"), wide=True, quick=True)
def _finish(
    batch: Batch,
    states: search.State,
    polished: list[jax.Array] | None,
    known: tuple[jax.Array, jax.Array] | None,
    slack: jax.Array,
    config: PathConfig,
    places: int | None,
) -> tuple[dict[str, jax.Array], search.History]:
    """Return the best paths, as fields of `PathPlans` but for the history, and its last rows.

    Args:
        batch: the legs, in the world that paths are judged in.
        states: populations after the search.
        polished: the best of them after a descent, with costs and violations [B, R].
        known: `closed` and `known` of `trace_passages`.
        slack: share by which a path may be slower than that and leave nothing wanting.
        config: static settings.
        places: on each segment at which the current is met, as `timed_at_places` takes it.
    """

    def one(
        leg: Legs,
        state: search.State,
        polished: list[jax.Array] | None,
        known: tuple[jax.Array, jax.Array] | None,
    ) -> tuple[dict[str, jax.Array], search.History]:
        problem, own, factor = batch.posed(leg, config)
        env, vehicle = problem.env, problem.vehicle
        if polished is not None:
            # The polished elite is ranked into the population.
            parts = zip((state.population, state.cost, state.violation), polished, strict=True)
            state = search.init(*(old.at[: len(new)].set(new) for old, new in parts))
        track = tracks(state.population[:1], problem, own)
        trajectory, hidden = timed_at_places(track, problem.depart, env, vehicle, own, places)
        cost, _ = cost_of(trajectory, problem.straight_time, own)
        trajectory = judged_within(trajectory, env, vehicle, own)
        plan = _in_own_units(trajectory, cost[0], state, leg, factor) | {"hidden": hidden[0] / factor}
        if known is None:
            no = jnp.zeros((), bool)
            plan |= {"closed": jnp.zeros(()), "wanting": no, "slower": no}
        else:
            closed, quickest = known
            broken = violations(trajectory)[:, 0].sum() > 0.0
            roundabout = trajectory.travel_time[0] > _ROUNDABOUT * WAY / vehicle.speed
            exists, lasts = jnp.isfinite(quickest), trajectory.travel_time[0]
            if vehicle.depth_toll is not None:
                lasts = lasts + toll(track.way[2], vehicle.depth_toll)[0]
            wanting = exists & ((lasts > (1.0 + slack) * quickest) | roundabout)
            plan |= {"closed": closed / factor, "wanting": jnp.where(broken, closed == 0.0, wanting)}
            plan |= {"slower": exists & (lasts > quickest)}
        return plan, _in_seconds(search.statistics(state), leg)

    return batch.over_legs(one, states, polished, known)


def _in_seconds(history: search.History, leg: Legs) -> search.History:
    """Return a history whose costs are those of the leg itself."""
    factor = factor_of(leg.start, leg.goal)
    return replace(history, **{name: getattr(history, name) / factor for name in ("best", "mean", "std")})


def _in_own_units(
    trajectory: Trajectory, cost: jax.Array, state: search.State, leg: Legs, factor: jax.Array
) -> dict[str, jax.Array]:
    """Return the fields of a `PathPlan` by name, from what was found in a world `factor` times as great."""
    found, inner = trajectory.fields(), state.population[0].reshape(3, -1).T / factor
    # Excess counts metres of missing clearance and altitude, and shares of all other limits.
    metres = [name in ("coast", "obstacle", "seabed") for name in VIOLATIONS]
    excess = found.pop("excess")
    excess = jnp.where(np.asarray(metres)[:, None], excess / factor, excess)
    return {
        "water": found.pop("water"),
        **{name: value / factor for name, value in found.items()},
        "control_points": jnp.concatenate([leg.start[None], inner, leg.goal[None]]),
        "violations": excess.mean(axis=1),
        "cost": cost / factor,
        "population": state.population / factor,
        "excess": excess,
    }
