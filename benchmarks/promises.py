"""Promises of plans against what is kept in seas that no plan knows: ``python -m benchmarks.promises``.

Three seas, plans of several promises in each, and every plan followed in a thousand true seas by code of this
file alone. Where vortices change by Eq. 2 the true ones are drawn again here, in NumPy. Off Washington the
truth is RTOFS itself; its forecast is the same a lunar day earlier, and its members are up to four days old.
In the fjord the truth is ROMS with an error made of vortices, the forecast ROMS, and what is known of the
error its size and length. Tasks last longer or shorter by a tenth. With `--fixed`, shares of the time that
are kept back are compared, the same for all missions; with `--turning`, plans with a rule for what is late.
The priority is what is won in the true seas.
"""

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

import auvplan as ap
from auvplan.executive.context import Mission
from auvplan.executive.loop import complete
from auvplan.executive.planning import leaving, load_area_at, planning_context
from auvplan.executive.promise import plan_with_promise, planned_with, promise_of
from auvplan.ocean.currents import evaluated
from auvplan.ocean.vortices import LambVortices
from auvplan.plot import style
from auvplan.runtime import prng
from benchmarks.harness import SCENARIOS, SHARED, launch, means, show, track

TRUTHS, TASK_ERROR = 1000, 0.1
PROMISES = 0.8, 0.95, 0.99
FIXED = 0.0, 0.01, 0.02, 0.03, 0.045, 0.06, 0.1, 0.2, 0.3, 0.4
#: h, age of the forecast off Washington, and of its other members: lunar days and halves of them, so that
#: tides are in phase.
AGE, AGES = 24.84, (37.26, 49.68, 62.1, 74.52, 86.94, 99.36)
#: m/s and m, root mean square and length of the error in the fjord.
ERROR, LENGTH = 0.1, 500.0
#: m, steps that true tracks are followed in; of a leg there are so many at most.
STEP, STEPS = 25.0, 120

RTOFS = SHARED / "currents" / "rtofs_water_u_v_washington_64x3h.nc"

#: Velocity, m/s north and east [D], at a place, m, and D times, s.
Truth = Callable[[float, float, float, np.ndarray], tuple[np.ndarray, np.ndarray]]

KEPT = {
    "sea": "{sea}", "promise": "{asked}", "plans": "{plans}", "not kept": "{refused}",
    "stated": "{stated:.1%}", "of": "{low:.1%} to {high:.1%}", "kept": "{kept:.1%}",
    "priority": "{priority:.2f}", "time left": "{left:.1%}",
}  # fmt: skip


def cases(sea: str, seed: int, folder: Path, fixed: bool, turning: bool) -> Iterator[dict[str, Any]]:
    """Yield the plans of one mission, each with the share of true seas that it is home in time in."""
    mission, truth = WORLDS[sea](seed, folder)
    rng = np.random.default_rng(10_000 + seed)
    known = truth(rng)
    for asked in PROMISES:
        run = plan_with_promise(mission.fork(), asked, complete).run
        promise = run.promise
        assert promise is not None
        yield row(sea, seed, f"{asked:g}", run, promise, known, rng)
    for asked in PROMISES if turning else ():
        rules = mission.context.scenario.with_({"planning.turn_back": True})
        run = plan_with_promise(
            mission.fork(context=replace(mission.context, scenario=rules)), asked, complete
        ).run
        yield row(sea, seed, f"{asked:g}, with a rule", run, run.promise, known, rng)
    for kept in FIXED if fixed else ():
        one = planned_with(mission, kept, complete)
        if one.found is not None:
            promise = promise_of(one.found, mission, None, kept)
            yield row(sea, seed, f"{kept:g} left", one.mission.run, promise, known, rng)


def row(sea: str, seed: int, asked: str, run: Any, promise: Any, truth: Truth, rng: Any) -> dict[str, Any]:
    ends, won = follow(run, promise.turns, truth, rng)
    home = ends <= run.t_available
    return {
        "sea": sea, "seed": seed, "asked": asked, "refused": not promise.kept, "stated": promise.share,
        "low": promise.low, "high": promise.high, "kept": float(home.mean()),
        "priority": float(won.mean()), "left": promise.left,
    }  # fmt: skip


def summary(sea: str, asked: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return means of the plans of one kind that keep what they promise by their own account."""
    those = [one for one in rows if one["sea"] == sea and one["asked"] == asked]
    good = [one for one in those if not one["refused"]] or those
    counts = {"sea": sea, "asked": asked, "plans": len(those), "refused": len(those) - len(good)}
    return counts | means(good, ("stated", "low", "high", "kept", "priority", "left"))


def follow(run: Any, turns: Any, truth: Truth, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Follow a plan in D true seas; the vehicle crabs to hold its track, and turns where it is too late.

    Returns:
        ``(end [D] s, priority [D])``.
    """
    now, won, there = np.zeros(TRUTHS), np.zeros(TRUTHS), np.zeros(TRUTHS, int)
    own, last = float(np.asarray(run.vehicle.speed)), len(run.done)

    def task(seconds: float) -> np.ndarray:
        return seconds * np.maximum(1.0 + TASK_ERROR * rng.standard_normal(TRUTHS), 0.0)

    for number, leg in enumerate(run.done):
        going = there == number
        otherwise = [turn for turn in turns if turn.leg == number - 1]
        for turn in sorted(otherwise, key=lambda turn: -turn.latest):
            late = going & (now > turn.latest)
            going &= ~late
            ends, priority, to = along_track(np.asarray(turn.positions), own, now, truth), 0.0, last
            if turn.past is not None:
                to, edge = turn.past + 1, (leg.start, run.done[turn.past].goal)
                ends, priority = ends + task(run.graph.duration[edge]), run.graph.priority[edge]
            now, won = np.where(late, ends, now), won + np.where(late, priority, 0.0)
            there = np.where(late, to, there)
        pace = float(np.asarray(run.vehicle_on(leg).speed))
        ends = along_track(np.asarray(leg.positions, float), pace, now, truth) + task(leg.t_task)
        now, won = np.where(going, ends, now), won + np.where(going, leg.priority, 0.0)
        there = np.where(going, number + 1, there)
    return now, won


def along_track(places: np.ndarray, speed: float, now: np.ndarray, truth: Truth) -> np.ndarray:
    """Return when a vehicle that begins a path [S, 3] m at times [D] s is at its end in D seas, [D] s."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    marks = np.linspace(0.0, along[-1], int(np.clip(math.ceil(along[-1] / STEP), 1, STEPS)) + 1)
    points = np.stack([np.interp(marks, along, axis) for axis in places.T], axis=1)
    pace = np.full(len(now), speed)
    for a, b in pairwise(points):
        gap = float(np.linalg.norm(b - a))
        if gap == 0.0:
            continue
        north, east = truth(*(0.5 * (a + b)), now + 0.5 * gap / pace)
        tangent = (b - a) / gap
        with_it = north * tangent[0] + east * tangent[1]
        across = np.maximum(north**2 + east**2 - with_it**2, 0.0)
        pace = np.maximum(with_it + np.sqrt(np.maximum(speed**2 - across, 0.0)), 0.02 * speed)
        now = now + gap / pace
    return now


def mission_of(scenario: ap.Scenario, seed: int, depart: float = 0.0) -> Mission:
    area = load_area_at(scenario, [depart])
    context = planning_context(scenario, None, area, depart)
    (mission,) = leaving(context, prng.of_seeds([seed])[0], [depart], seed)
    return mission


def vortices(seed: int, folder: Path) -> tuple[Mission, Callable[[Any], Truth]]:
    """The shipped scenario without obstacles: the truth differs from the forecast and changes by Eq. 2."""
    scenario = ap.load_scenario("whitsunday").with_({
        "simulation.obstacles": {"static": 0, "afloat": 0, "self_motivated": 0},
        "current.forecast_error": 0.1, "mission.duration_error": TASK_ERROR,
    })  # fmt: skip
    mission, settings = mission_of(scenario, seed), scenario.current
    field = jax.device_get(mission.sea.forecast())
    assert isinstance(field, LambVortices)
    layers, count = field.strength.shape
    depths = np.asarray(field.depths, float)

    def drawn(rng: np.random.Generator) -> Truth:
        steps = math.ceil(1.2 * scenario.mission.time_available / settings.update_interval)
        first = settings.forecast_error * rng.standard_normal((TRUTHS, count, 3))
        radius = np.asarray(field.radius, float) * np.ones((TRUTHS, 1, 1))
        centers = np.asarray(field.centers, float) + first[:, None, :, :2] * radius[..., None]
        strength = np.asarray(field.strength, float) * (1.0 + first[:, None, :, 2])
        held = []
        for _ in range(steps + 1):
            held.append((centers.copy(), strength.copy(), radius.copy()))
            change = settings.update_rate * rng.standard_normal((TRUTHS, 1, count, 4))
            centers += settings.center_std * change[..., :2]
            strength *= 1.0 + settings.strength_std * change[..., 3]
            radius = np.maximum(radius + settings.radius_std * change[..., 2], 50.0)
        centers, strength, radius = (np.stack(part) for part in zip(*held, strict=True))

        def truth(x: float, y: float, z: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            number = np.clip(t // settings.update_interval, 0, steps).astype(int), np.arange(TRUTHS)
            north, east = (place - centers[number][..., axis] for axis, place in enumerate((x, y)))
            square, size = north**2 + east**2, radius[number]
            turn = strength[number] / (2.0 * np.pi * square) * -np.expm1(-square / size**2)
            u, v = -(turn * east).sum(axis=-1), (turn * north).sum(axis=-1)
            weights = np.asarray([np.interp(z, depths, row) for row in np.eye(layers)])
            return u @ weights, v @ weights

        return truth

    return mission, drawn


def ocean(seed: int, folder: Path) -> tuple[Mission, Callable[[Any], Truth]]:
    """A day off Washington by forecasts that are one to four days old."""
    with xr.open_dataset(RTOFS, decode_times=False) as data:
        for age in (AGE, *AGES):
            path = folder / f"{age}.nc"
            if not path.exists():
                later = data["time"].values + age / (1.0 if "hour" in data["time"].units else 24.0)
                data.assign_coords(time=("time", later, data["time"].attrs)).to_netcdf(path)
    hour = 100 + 5 * (seed % 13)
    moment = np.datetime64("2024-10-28T03:00") + np.timedelta64(hour, "h")
    scenario = ap.load_scenario(SCENARIOS / "ocean.yaml").with_({
        "current.files": str(folder / f"{AGE}.nc"), "current.truth": str(RTOFS),
        "current.members": {"files": [str(folder / f"{age}.nc") for age in AGES]},
        "site.departure": f"{moment}:00Z", "mission.time_available": 86_400,
        "area.lower": [-12_000, -12_000, 0], "area.upper": [12_000, 12_000, 5],
        "mission.duration_error": TASK_ERROR,
    })  # fmt: skip
    mission = mission_of(scenario, seed)
    known = load_area_at(scenario, [0.0]).truth
    assert known is not None
    return mission, lambda rng: partial(looked_up, known)


def fjord(seed: int, folder: Path) -> tuple[Mission, Callable[[Any], Truth]]:
    """The fjord of ROMS, with an error of a known size."""
    members = {"error": ERROR, "length": LENGTH, "duration": 43_200}
    scenario = ap.load_scenario(SCENARIOS / "fjord.yaml").with_({
        "current.members": members, "mission.duration_error": TASK_ERROR, "mission.time_available": 4500,
    })  # fmt: skip
    mission = mission_of(scenario, seed)
    known, (low, high) = mission.sea.forecast(), scenario.box

    def drawn(rng: np.random.Generator) -> Truth:
        erring = drawn_errors(rng, np.asarray(low)[:2], np.asarray(high)[:2], TRUTHS)

        def truth(x: float, y: float, z: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            u, v = looked_up(known, x, y, z, t)
            du, dv = erring(x, y)
            return u + du, v + dv

        return truth

    return mission, drawn


def looked_up(current: Any, x: float, y: float, z: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a current at one place and many times, m/s north and east."""
    u, v, _ = evaluated(current, *(np.full(len(t), axis) for axis in (x, y, z)), t)
    return u, v


def drawn_errors(
    rng: np.random.Generator, low: np.ndarray, high: np.ndarray, count: int
) -> Callable[[Any, Any], tuple[np.ndarray, np.ndarray]]:
    """Draw D errors of a current, each a sum of Gaussian vortices in a box, and about it.

    Args:
        low, high: [2] m, north and east, corners of the box.

    Returns:
        Takes a place, m north and east, one or [D, 1] of them, and returns velocities [D] m/s.
    """
    side = high - low + 4.0 * LENGTH
    vortices = max(int(np.prod(side) / LENGTH**2), 4)
    centers = low - 2.0 * LENGTH + rng.uniform(size=(count, vortices, 2)) * side
    strength = rng.standard_normal((count, vortices))

    def erring(x: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        north, east = x - centers[..., 0], y - centers[..., 1]
        turn = strength * np.exp(-(north**2 + east**2) / (2.0 * LENGTH**2)) / LENGTH
        return -(turn * east).sum(axis=-1), (turn * north).sum(axis=-1)

    squares = [np.mean(np.square(erring(*place))) for place in rng.uniform(low, high, (64, 2))]
    strength *= ERROR / math.sqrt(float(np.mean(squares)))
    return erring


WORLDS = {"vortices": vortices, "ocean": ocean, "fjord": fjord}


def draw(rows: list[dict[str, Any]], picture: Path) -> None:
    """Draw what was promised against what was kept: plans, and their means in ten bins."""
    figure = style.new_figure(6.0, 5.4)
    axes = figure.subplots()
    axes.plot([0, 100], [0, 100], color=style.GREY, lw=1.0, zorder=1)
    colours = dict(zip(WORLDS, (style.BLUE, style.ORANGE, style.GREEN), strict=True))
    for sea in dict.fromkeys(row["sea"] for row in rows):
        stated, kept = (
            100.0 * np.asarray([row[of] for row in rows if row["sea"] == sea]) for of in ("stated", "kept")
        )
        axes.scatter(stated, kept, s=12, alpha=0.35, color=colours[sea], lw=0)
        bins = np.clip(stated // 10.0, 0, 9)
        points = [(stated[bins == k].mean(), kept[bins == k].mean()) for k in np.unique(bins)]
        axes.plot(*np.transpose(points), "o-", color=colours[sea], label=sea, ms=5)
    axes.set(xlabel="promised: home in time in drawn seas [%]", ylabel="kept in true seas [%]")
    axes.set_aspect("equal")
    axes.legend(frameon=False)
    style.grid(axes)
    figure.savefig(picture)


@launch(
    seas=(list(WORLDS), "seas", list(WORLDS)),
    seeds=(range(20), "missions in each"),
    fixed=(False, "compare shares of the time that are kept back, too"),
    turning=(False, "compare plans with a rule for what is late, too"),
    picture=(Path, "PNG of what was promised against what was kept"),
)
def main(seas: list[str], seeds: range, fixed: bool, turning: bool, picture: Path | None) -> dict[str, Any]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for sea in seas:
            for seed in track(seeds, sea):
                rows += list(cases(sea, seed, Path(folder), fixed, turning))
    kept = [
        summary(sea, asked, rows) for sea in seas for asked in dict.fromkeys(row["asked"] for row in rows)
    ]
    show("plans of promises, and how many of the true seas they are home in time in", kept, KEPT)
    if picture is not None:
        draw(rows, picture)
    return {"promises": kept, "plans": rows}
