"""Scoring a population of paths: the package's kernel against one in C, and the price of gradients.

`python -m benchmarks.scoring` times 100 and 10,000 paths of 128 samples with 16 free control points. The
contenders take turns; C runs on one thread, JAX on as many as it likes. All must agree, cusps included: on
99.9 % of all paths to 1e-5, on every path to 1e-4. `score.c` takes what the problem here has: one layer of
vortices, spheres in linear motion, a chart, a steady current, the "track" reading of the speed and, in the
vertical, a limit on pitch.
"""

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.vortices import LambVortices
from auvplan.path import habitats
from auvplan.path.bspline import basis_matrix
from auvplan.path.cost import score
from auvplan.path.problem import Problem as Leg
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle
from benchmarks.harness import Array, clock, compiler, launch, screen, show, take_turns

COUNTS = (100, 10_000)
ROUNDS = 30
#: s, length of a turn; at least one call.
TURN = 0.1
#: Relative difference of costs that counts as agreement, the share of paths that must agree, and the largest
#: difference of any path. A cusp's segments are centimetres long: of 10,000 paths a few lose digits there.
AGREEMENT, AGREEING, APART = 1e-5, 0.999, 1e-4
SIDE, PIXEL = 3500.0, 10.0

Scores = tuple[Array, Array]

SOURCE = Path(__file__).with_name("score.c")
#: Sums in the order they are written in: as quick, and turn rates lose fewer digits.
FLAGS = ("-O3", "-ffast-math", "-fno-associative-math", "-shared", "-fPIC")
#: The first of these that the compiler takes.
TARGETS = (("-march=native", "-mprefer-vector-width=512"), ("-march=native",), ("-mcpu=native",), ())


#: Limits that the twins know, in the order of score.c.
LIMITS = "surge", "sway", "turn_rate", "coast", "obstacle", "current", "pitch"

#: Members of `Packed`, in the order of score.c.
INTEGERS = "samples controls order vortices obstacles north east"
REALS = (
    "depart speed surge_max sway_max turn_rate_max pitch_speed coast_margin obstacle_margin uncertain_price "
    "chart_error origin_north origin_east pixel_size straight"
)
ARRAYS = "first basis first_step step ends vortex obstacle chart"


class Packed(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int32) for name in INTEGERS.split()),
        *((name, ctypes.c_float) for name in REALS.split()),
        ("uniform", ctypes.c_float * 3),
        ("weights", ctypes.c_float * len(LIMITS)),
        *((name, ctypes.c_void_p) for name in ARRAYS.split()),
    )


@dataclass(frozen=True)
class Problem:
    """A leg to score paths for."""

    start: jax.Array  # [3] m
    goal: jax.Array  # [3] m
    env: ap.Environment  # the world, obstacles resolved
    vehicle: Vehicle
    config: ap.PathConfig

    @property
    def leg(self) -> Leg:
        """The leg as the package's kernels take it."""
        return Leg(self.start, self.goal, jnp.zeros(()), self.env, self.vehicle)

    def cost(self, paths: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Cost [P] s and violation [P] of habitats [P, 3 n] m, by the kernel of the package."""
        return score(paths, self.leg, self.config)

    def bounds(self) -> tuple[jax.Array, jax.Array]:
        """Least and largest habitat, [3 n] m each."""
        return habitats.bounds(self.leg, self.config)

    def paths(self, count: int, seed: int = 0) -> jax.Array:
        """[count, 3 n] m, smooth detours of all sizes."""
        return habitats.initial(jax.random.key(seed), count, self.leg, *self.bounds(), self.config)

    def numbers(self) -> dict[str, Any]:
        """The problem as plain numbers and contiguous single-precision arrays, named as in score.c."""
        env, config, vehicle = self.env, self.config, self.vehicle
        current, balls, chart = env.current, env.obstacles, env.chart
        assert isinstance(current, LambVortices)
        assert chart is not None
        assert current.strength.shape[0] == 1
        radius2, strength = np.asarray(current.radius[0]) ** 2, np.asarray(current.strength[0])
        scale = strength / (2.0 * np.pi * radius2)
        rate = -np.log2(np.e) / (2.0 * radius2)
        vortex = [*np.asarray(current.centers[0]).T, rate, scale, scale * np.asarray(current.vertical_scale)]
        growth = np.asarray(balls.growth)
        boundary = np.asarray(balls.boundary(balls.observed_at))
        state = [*np.asarray(balls.position).T, *np.asarray(balls.velocity).T, growth]
        obstacle = [*state, np.asarray(balls.growth_max), np.asarray(balls.observed_at), boundary]
        order = config.degree + 1
        dense = basis_matrix(config.samples, config.control_points + 2, config.degree)
        first = np.minimum((dense > 0.0).argmax(axis=1), dense.shape[1] - order)
        sides = -np.cumsum(np.diff(dense, axis=0, prepend=dense[:1]), axis=1)
        first_step = np.minimum(np.roll(first, 1), dense.shape[1] - order - 1)
        first_step[0] = 0
        ends = np.stack([self.start, self.goal])
        arrays = {
            "basis": np.take_along_axis(dense, first[:, None] + np.arange(order), axis=1),
            "step": np.take_along_axis(sides, first_step[:, None] + np.arange(order), axis=1),
            "ends": ends,
            "vortex": np.stack(vortex, axis=1)[strength != 0.0],
            "chart": np.stack([chart.signed_distance, chart.passability], axis=2),
            "obstacle": np.stack(obstacle, axis=1)[np.asarray(balls.active)],
        }
        origin, pixel, speed = np.asarray(chart.origin), float(chart.pixel_size), np.asarray(vehicle.speed)
        limits = ("speed", "surge_max", "sway_max", "turn_rate_max")
        prices = ("coast_margin", "obstacle_margin", "uncertain_price")
        return {
            **{name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()},
            **{name: float(np.asarray(getattr(vehicle, name))) for name in limits},
            **{name: getattr(config, name) for name in prices},
            "first": first.astype(np.int32), "first_step": first_step.astype(np.int32),
            "samples": config.samples, "controls": config.control_points, "order": order,
            "vortices": len(arrays["vortex"]), "obstacles": len(arrays["obstacle"]),
            "north": chart.shape[0], "east": chart.shape[1], "pixel_size": pixel,
            "origin_north": float(origin[0]), "origin_east": float(origin[1]),
            "chart_error": INTERPOLATION_ERROR * pixel, "depart": 0.0,
            "straight": float(np.linalg.norm(ends[1] - ends[0])) / float(speed),
            "pitch_speed": float(vehicle.vertical_limits["pitch"]),
            "uniform": np.asarray(current.uniform, np.float32),
            "weights": np.array([getattr(config.penalties, name) for name in LIMITS], np.float32),
        }  # fmt: skip


def problem(seed: int = 0) -> Problem:
    """A leg of 4 km past islands, shallows and drifting obstacles, on a chart of 350 x 350 pixels."""
    rng = np.random.default_rng(seed)
    start, goal = np.array([200.0, 300.0, 10.0]), np.array([3200.0, 3000.0, 50.0])
    low, high = jnp.zeros(3), jnp.array([SIDE, SIDE, 100.0])
    current, side = ap.random_vortices(jax.random.key(seed + 1), low, high, count=12), int(SIDE / PIXEL)
    north, east = np.meshgrid(*[(np.arange(side) + 0.5) * PIXEL] * 2, indexing="ij")
    raster = np.ones_like(north, np.float32)
    for value, count, size in ((0.2, 6, 350.0), (0.0, 8, 200.0)):
        for centre in rng.uniform(0.0, SIDE, (count, 2)):
            if min(np.linalg.norm(centre - start[:2]), np.linalg.norm(centre - goal[:2])) > 2.0 * size:
                raster[np.hypot(north - centre[0], east - centre[1]) < size * rng.uniform(0.5, 1.0)] = value
    share = rng.uniform(0.2, 0.8, 12)[:, None]
    places = start + (goal - start) * share + rng.normal(0.0, 150.0, (12, 3))
    spheres = ap.Obstacles.afloat(places, rng.uniform(30.0, 120.0, 12), growth=0.05)
    chart = ap.Chart.from_passability(raster, PIXEL)
    env = ap.Environment(current, chart, spheres.resolved(current), low, high)
    return Problem(jnp.asarray(start, float), jnp.asarray(goal, float), env, Vehicle(), ap.PathConfig())


@cache
def library() -> ctypes.CDLL | None:
    """The compiled C source; None where no compiler is found or none succeeds."""
    path = compiler()
    if path is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "score.so"
        for machine in TARGETS:
            command = [path, *FLAGS, *machine, "-o", str(target), str(SOURCE), "-lm"]
            if subprocess.run(command, capture_output=True).returncode == 0:
                found = ctypes.CDLL(str(target))
                pointer = ctypes.c_void_p
                found.score.argtypes = [ctypes.POINTER(Packed), pointer, ctypes.c_int, pointer, pointer]
                return found
    return None


def in_c(values: dict[str, Any]) -> Callable[[Array], Scores] | None:
    """``score(habitats [P, 3 n] m) -> (cost [P] s, violation [P])`` in C; None without a compiler.

    Args:
        values: of the problem, as `Problem.numbers` has them.
    """
    compiled = library()
    if compiled is None:
        return None
    packed = Packed()
    for name in (*INTEGERS.split(), *REALS.split()):
        setattr(packed, name, values[name])
    for name in ARRAYS.split():
        setattr(packed, name, values[name].ctypes.data)
    packed.uniform[:] = values["uniform"].tolist()
    packed.weights[:] = values["weights"].tolist()

    def call(paths: Array, keep: dict[str, Any] = values) -> Scores:
        cost, violation = np.empty((2, len(paths)), np.float32)
        given = ctypes.byref(packed), paths.ctypes.data, len(paths), cost.ctypes.data, violation.ctypes.data
        if compiled.score(*given):
            raise MemoryError("score.c: out of memory")
        return cost, violation

    return call


#: A row for each way to score a population: times over those of C and of the package's kernel, and the
#: largest relative difference to that one's costs.
TITLE = "Scoring paths of 128 samples: 12 vortices, 12 obstacles, 350 x 350 chart"
COLUMNS = {
    "paths": "{paths:,}", "what": "{name}", "time": "{milliseconds:.3f} ms", "least": "{least:.3f} ms",
    "to C": "{to_c:.2f}", "to JAX": "{to_value:.2f}", "compilation": "{compile_seconds:.2f} s",
    "difference of costs": "{difference:.1e}",
}  # fmt: skip

Contender = Callable[[jax.Array, Array], Any]


def contenders(problem: Problem) -> dict[str, tuple[Contender, float]]:
    """Ways to score and the s that making them took; a line for each that is missing.

    Each takes the same habitats [P, 3 n] twice, on the device and on the host, and returns the costs first.
    """
    value = compiled(problem.cost)

    def summed(paths: jax.Array) -> tuple[jax.Array, jax.Array]:
        cost = problem.cost(paths)[0]
        return cost.sum(), cost

    gradient = compiled(jax.value_and_grad(summed, has_aux=True))

    found: dict[str, tuple[Contender, float]] = {
        "JAX": (lambda device, _: value(device), 0.0),
        "JAX, cost and gradient": (lambda device, _: gradient(device)[0][1:], 0.0),
    }
    seconds, native = clock(lambda: in_c(problem.numbers()))
    if native is None:
        screen.print("C: left out, no C compiler that works was found")
    else:
        found["C, 1 thread"] = (lambda _, host: native(host), seconds)
    return found


def rows(rounds: int = ROUNDS) -> list[dict[str, Any]]:
    leg, result = problem(), []
    known = contenders(leg)
    for count in COUNTS:
        device = leg.paths(count)
        given = device, np.ascontiguousarray(device, np.float32)
        calls = {name: lambda _, call=call, given=given: call(*given) for name, (call, _) in known.items()}
        rates = take_turns(calls, dict.fromkeys(calls, rounds), 0, TURN)
        costs = {name: np.asarray(rate.pop("results")[0][0]) for name, rate in rates.items()}
        apart = {name: np.abs(cost - costs["JAX"]) / costs["JAX"] for name, cost in costs.items()}
        for name, gap in apart.items():
            if gap.max() > APART or (gap < AGREEMENT).mean() < AGREEING:
                raise RuntimeError(f"{name} and JAX disagree on the costs of {count} paths")
        native = rates.get("C, 1 thread", {"seconds": None})["seconds"]
        for name, rate in rates.items():
            row = {"paths": count, "name": name, "difference": float(apart[name].max())} | rate
            row["compile_seconds"] += known[name][1]
            row["to_c"] = None if native is None else rate["seconds"] / native
            row["to_value"] = rate["seconds"] / rates["JAX"]["seconds"]
            result.append(row)
    return result


@launch(rounds=(ROUNDS, "turns that every contender takes"))
def main(rounds: int) -> dict[str, Any]:
    found = rows(rounds)
    show(TITLE, found, COLUMNS, names=2)
    return {"rows": found}
