"""Rules that bring a vehicle home, each by a case that fails without it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.executive.loop import step
from auvplan.executive.route_calls import plan_routes
from auvplan.path import replan_path
from tests.executive.small import scenario
from tests.executive.test_visits import GOAL, at_waypoint
from tests.path.test_reuse import CONFIG, plan, time_left, world

pytestmark = pytest.mark.usefixtures("light_search")

__all__ = ["plan", "world"]

#: s that the route of `late` leaves beside the reserve.
SLACK = 100.0


def causes(late: float, reserve: float) -> list[str]:
    """Why routes were planned, where a mission is late by so many s at its first waypoint."""
    edges, taken = [(0, 1), (1, GOAL)], 3500.0 / 2.5
    mission = at_waypoint(edges, available=taken + reserve + SLACK, reserve=reserve, gain=1e6)
    plan_routes([mission])
    assert mission.slack == pytest.approx(SLACK, abs=1.0)
    mission.now += late
    step([mission])
    return [route.cause for route in mission.run.routes]


def test_the_reserve_is_not_eaten_unnoticed():
    """The rest of a route that overruns the reserve by more than the tolerance of 30 s is re-planned."""
    assert causes(SLACK + 25.0, 300.0) == ["start"]
    assert causes(SLACK + 45.0, 300.0) == ["start", "late"]


@pytest.mark.slow
def test_of_a_kept_population_the_best_is_kept(plan, world):
    """With noise around it and a share redrawn, it is the best alone that a re-plan can live off."""
    config = CONFIG.replace(fresh_share=0.3)
    rows = np.asarray(plan.population)
    rng = np.random.default_rng(0)
    low, high = np.array([0.0, 0.0, 20.0]), np.array([2500.0, 2500.0, 30.0])
    shape = (len(rows), 3, rows.shape[1] // 3)
    noise = rng.uniform(low[None, :, None], high[None, :, None], shape).reshape(len(rows), -1)
    noise[0] = rows[0]
    place, now, left = time_left(plan, 1.0 / 3.0)
    kept = replace(plan, population=jnp.asarray(noise, "float32"))
    new = replan_path(kept, place, now, world, key=jax.random.key(1), config=config)
    assert new.travel_time < 1.02 * left


def test_the_reserve_that_was_used_is_stated():
    run = ap.run_mission(scenario(), seed=0)
    reserve = run.planning.reserve
    assert run.summary()["reserve_used"] == run.reserve_used
    run.t_mission = run.t_available - reserve - 1.0
    assert run.reserve_used == 0.0
    run.t_mission = run.t_available - reserve / 3.0
    assert run.reserve_used == pytest.approx(2.0 * reserve / 3.0)
    run.t_mission = run.t_available + 50.0
    assert run.reserve_used == reserve
