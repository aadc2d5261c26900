"""The compiled search for a route: seeds from a beam, then biogeography-based optimisation."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.bbo import search
from auvplan.mission import beam, local_search
from auvplan.mission import decoder as decoders
from auvplan.mission import objective as objectives
from auvplan.mission.config import MissionConfig
from auvplan.mission.problem import Edges, Problem, prepare
from auvplan.runtime import prng
from auvplan.runtime.budget import Budget, share_of
from auvplan.runtime.compiled import compiled
from auvplan.runtime.rows import over_rows


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Missions:
    """Missions to be searched, stacked along an axis B.

    Attributes:
        edges: of the graphs.
        start, goal: [B] indices.
        time_available: [B] s.
        visited: [B, N] bool, waypoints not to be visited again.
        return_margin: [B] share by which the path to the goal is taken to last longer than expected.
        given: [B, P, D] habitats to start from, of which the first ones are used.
        known: [B, N] routes to start from, padded with -1; all -1 where there is none.
        least_difference: [B] in total priority, as `Problem` has it.
        energy_available: [B] J; None where it is not limited.
    """

    edges: Edges
    start: Any
    goal: Any
    time_available: Any
    visited: Any
    return_margin: Any
    given: Any
    known: Any
    least_difference: Any
    energy_available: Any = None


@partial(compiled, static_argnames=("config",), quick=True)
def search_missions(
    keys: jax.Array, missions: Missions, count: jax.Array, iterations: jax.Array, config: MissionConfig
) -> tuple[search.Result, decoders.Decoded, jax.Array]:
    """Search B missions at once, of which the first `count` habitats given are used.

    Rows of histories after the iterations to be made are zero.

    Returns:
        Results, decoded habitats [B, P, ...], best first, of "eq15" the best alone [B, 1, ...], and least
        times to the goal [B] s.
    """

    def one(key: jax.Array, mission: Missions) -> tuple[search.Result, decoders.Decoded, jax.Array]:
        ends, given = (mission.start, mission.goal), mission.given
        limits = mission.time_available, mission.visited, mission.return_margin, mission.energy_available
        problem = prepare(mission.edges, *ends, *limits, mission.least_difference)
        lower = jnp.full(given.shape[1], decoders.LOWEST, jnp.int32)
        upper = jnp.full(given.shape[1], decoders.HIGHEST, jnp.int32)
        decoded = partial(decoders.decode, decoder=config.decoder, rate_weight=config.rate_weight)
        start_key, run_key = jax.random.split(key)
        population = search.uniform_population(start_key, config.bbo.population, lower, upper)
        if config.plant:
            # Early arrival wastes a random habitat: the destination starts as the last resort.
            population = population.at[:, mission.goal].set(decoders.LOWEST)
        population = jnp.where(jnp.arange(config.bbo.population)[:, None] < count, given, population)
        if config.plant:
            population = _planted(population, mission.known, problem, config)
        result = search.run(
            run_key,
            lambda population, problem: _cost(decoded(population, problem), problem, config),
            population,
            lower,
            upper,
            config.bbo,
            (problem,),
            partial(_improved, config=config) if config.local_rounds else None,
            config.local_period,
            iterations,
        )
        shown = result.x[None] if config.objective == "eq15" else result.state.population
        return result, decoded(shown, problem), problem.time_to_go[mission.start]

    return over_rows(one)(keys, missions)


def search_within(
    budget: Budget | None,
    keys: jax.Array,
    missions: Missions,
    count: int,
    iterations: int,
    config: MissionConfig,
) -> tuple[search.Result, decoders.Decoded, jax.Array]:
    """`search_missions` in chunks as far as a budget goes, in one without; arguments as there.

    Where it is too short for a beam search, it starts without one.
    """
    share, kind = share_of(budget), (missions.given.shape, missions.known.shape, len(keys))
    seeded = config if share.allows((config, *kind)) else config.replace(seeds=0)
    done = iterations if budget is None else 0
    first = partial(search_missions, keys, missions, count=count, config=seeded)
    result, best, least = share.spend((seeded, *kind), partial(first, iterations=np.int32(done)))
    later, chunks = config.replace(seeds=0, plant=False), [search.rows(result.history, slice(0, done + 1))]
    while done < iterations and (chunk := share.units((later, *kind), iterations - done)):
        population = result.state.population
        search_on = partial(
            search_missions,
            prng.folded_rows(keys, done + 1),
            replace(missions, given=population),
            count=population.shape[1],
            iterations=np.int32(chunk),
            config=later,
        )
        result, best, _ = share.spend((later, *kind), search_on, chunk + 1)
        chunks.append(search.rows(result.history, slice(1, chunk + 1)))
        done += chunk
    return replace(result, history=search.joined(chunks, iterations - done)), best, least


def _planted(population: jax.Array, known: jax.Array, problem: Problem, config: MissionConfig) -> jax.Array:
    """Put the known, the shortest, the beam's and the greediest routes over the last habitats."""
    greedy = decoders.greedy_habitat(problem, config.decoder)[None]
    nodes = jnp.stack([known, decoders.shortest_route(problem)])
    if problem.levels is not None:
        # As many as there is room for beside those of a beam.
        levels, room = len(problem.levels.goal), len(population) - config.seeds - 4
        chosen = np.unique(np.linspace(0, levels - 1, min(levels, room)).round().astype(int))
        shortest = jax.vmap(decoders.shortest_route)(jax.tree.map(lambda leaf: leaf[chosen], problem.levels))
        nodes = jnp.concatenate([nodes, shortest])
    usable = nodes[:, 0] >= 0
    if config.seeds:
        route = decoders.decode(greedy, problem, config.decoder, config.rate_weight)
        # Of a route that takes no time and does no task; each edge lowers it by `_gain`.
        idle = config.phi1 * problem.time_available if config.objective == "eq15" else jnp.zeros(())
        saved = jnp.where(route.reached, idle - _cost(route, problem, config)[0], 0.0)
        found, gains = beam.seed_routes(
            problem, _gain(problem, config), saved[0], *config.beam(*problem.neighbours.shape), config.seeds
        )
        nodes = jnp.concatenate([nodes, found])
        usable = jnp.concatenate([usable, gains > -jnp.inf])
    last = population[-len(nodes) :]
    seeds = jnp.where(usable[:, None], decoders.encode(nodes, last, config.decoder), last)
    return jnp.concatenate([population[: -len(nodes) - 1], greedy, seeds])


def _improved(population: jax.Array, problem: Problem, config: MissionConfig) -> jax.Array:
    """Return the best habitats after local search on their routes, [local_width, D]."""
    best = population[: config.local_width]
    routes = decoders.decode(best, problem, config.decoder, config.rate_weight)
    nodes = local_search.improve(routes.nodes, problem, _gain(problem, config), config.local_rounds)
    changed = routes.reached & (nodes != routes.nodes).any(axis=1)
    return jnp.where(changed[:, None], decoders.encode(nodes, best, config.decoder), best)


def _cost(routes: decoders.Decoded, problem: Problem, config: MissionConfig) -> tuple[jax.Array, jax.Array]:
    """Cost and violation [P] of routes."""
    if config.objective == "eq15":
        cost = objectives.eq15(routes, problem, config.phi1, config.phi2)
    else:
        cost = objectives.total_priority(routes, problem, config.time_weight, config.saves)
    return cost, objectives.violation(routes, problem)


def _gain(problem: Problem, config: MissionConfig) -> jax.Array:
    """[N, K] by how much each edge lowers the cost."""
    if config.objective == "eq15":
        return objectives.eq15_gain(problem, config.phi1, config.phi2)
    return objectives.total_priority_gain(problem, config.time_weight, config.saves)
