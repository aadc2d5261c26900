"""The path cost of `auvplan.path.cost.score` written again in C and in Numba, to compare times with.

Both twins take what the benchmark's problem has: one layer of vortices, spheres in linear motion, a chart, a
steady current, the "track" reading of the speed and, in the vertical, a limit on pitch.
"""

import ctypes
import math
import subprocess
import tempfile
from collections import namedtuple
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from auvplan.path.cost import CLEARANCE_SCALE
from auvplan.vehicle import SPEED_FLOOR
from benchmarks.machine import compiler

Array = np.ndarray[Any, Any]
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
        values: of the problem, as `scoring.Problem.numbers` has them.
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


def in_numba(values: dict[str, Any]) -> Callable[[Array], Scores]:
    """The same in Numba."""
    kernel = numba_kernel()
    single = {name: np.float32(v) if isinstance(v, float) else v for name, v in values.items()}
    packed = namedtuple("Numbers", single)(**single)
    return lambda paths: kernel(paths, packed)


@cache
def numba_kernel() -> Callable[[Array, Any], Scores]:
    """``score(habitats, numbers)`` compiled by Numba, one path after another, planes [samples] of each."""
    import numba

    # Plain Python numbers would turn the arithmetic into double precision.
    one, half, two, zero, tiny, far = (np.float32(v) for v in (1.0, 0.5, 2.0, 0.0, 1e-8, 1e6))
    lowest, c6, c24, c120 = (np.float32(v) for v in (-126.0, 1 / 6, 1 / 24, 1 / 120))
    near, to_q, floor_share, beaten_share = (
        np.float32(v) for v in (0.02, -2.0 * np.log(2.0), SPEED_FLOOR, 1.0 - SPEED_FLOOR**2)
    )
    power = tuple(
        np.float32(v)
        for v in (1.326697039e-3, 9.675459746e-3, 5.550742616e-2, 0.2402212175, 0.6931469492, 1.0)
    )
    unit = np.float32(1.0 / CLEARANCE_SCALE)
    compiled = numba.njit(fastmath=True, error_model="numpy")

    @compiled
    def power_of_two(x):
        x = max(x, lowest)
        whole = np.int32(x - half)
        f = x - np.float32(whole)
        p = ((((power[0] * f + power[1]) * f + power[2]) * f + power[3]) * f + power[4]) * f + power[5]
        return p * np.int32((whole + 127) << 23).view(np.float32)

    @compiled
    def positions(q, habitat, control, x, w):
        for axis in range(3):
            control[0], control[-1] = q.ends[0, axis], q.ends[1, axis]
            control[1:-1] = habitat[axis * q.controls : (axis + 1) * q.controls]
            for s in range(q.samples):
                x[axis, s] = zero
            for k in range(q.order):
                for s in range(q.samples):
                    x[axis, s] += q.basis[s, k] * control[q.first[s] + k]
            for s in range(1, q.samples):
                w[axis, s - 1] = zero
            for k in range(q.order):
                for s in range(1, q.samples):
                    first = q.first_step[s] + k
                    w[axis, s - 1] += q.step[s, k] * (control[first + 1] - control[first])

    @compiled
    def current(q, x, u):
        for s in range(q.samples - 1):
            u[3, s], u[4, s] = half * (x[0, s] + x[0, s + 1]), half * (x[1, s] + x[1, s + 1])
            u[0, s], u[1, s], u[2, s] = q.uniform
        for k in range(q.vortices):
            north, east, rate, scale, vertical = q.vortex[k]
            for s in range(q.samples - 1):
                dx, dy = u[3, s] - north, u[4, s] - east
                r2 = dx * dx + dy * dy
                e, p = power_of_two(r2 * rate), r2 * rate * to_q
                series = one - p * (half - p * (c6 - p * (c24 - p * c120)))
                turn = scale * (series if p < near else (one - e * e) / p)
                u[0, s] -= turn * dy
                u[1, s] += turn * dx
                u[2, s] += vertical * e

    @compiled
    def kinematics(q, w, u, d, t):
        """Rows of d: dx, dy, squared level way, way, duration. Excess of surge, sway, current and pitch."""
        surge = sway = beaten = steep = zero
        floor = floor_share * q.speed
        for s in range(q.samples - 1):
            dx, dy, dz = w[0, s], w[1, s], w[2, s]
            level = dx * dx + dy * dy
            gap = np.sqrt(level + dz * dz + tiny)
            along = (u[0, s] * dx + u[1, s] * dy + u[2, s] * dz) / gap
            rest = u[0, s] * u[0, s] + u[1, s] * u[1, s] + u[2, s] * u[2, s] - along * along
            across = np.sqrt(max(rest, zero) + tiny)
            progress = along + np.sqrt(max((q.speed - across) * (q.speed + across), floor * floor))
            ground = max(progress, floor)
            d[0, s], d[1, s], d[2, s], d[3, s], d[4, s] = dx, dy, level, gap, gap / ground
            surge += max(ground / q.surge_max - one, zero)
            sway += max(across / q.sway_max - one, zero)
            beaten += max(floor - progress, zero) + max(across - beaten_share * q.speed, zero)
            steep += max(abs(dz * ground / gap - u[2, s]) / q.pitch_speed - one, zero)
        t[0] = q.depart
        for s in range(q.samples - 1):
            t[s + 1] = t[s] + d[4, s]
        return surge, sway, beaten / q.speed, steep

    @compiled
    def turns(q, d):
        excess = zero
        for s in range(1, q.samples - 1):
            cross = d[0, s - 1] * d[1, s] - d[1, s - 1] * d[0, s]
            dot = d[0, s - 1] * d[0, s] + d[1, s - 1] * d[1, s]
            fade = one - tiny / (cross * cross + dot * dot + tiny)
            rate = two * fade * abs(math.atan2(cross, dot)) / (d[4, s - 1] + d[4, s])
            excess += max(rate / q.turn_rate_max - one, zero)
        return excess

    @compiled
    def coast(q, x, d, c):
        """Excess and price; c: distance to the coast and risk at every sample."""
        high_x, high_y = (
            q.origin_north + q.pixel_size * np.float32(q.north),
            q.origin_east + q.pixel_size * np.float32(q.east),
        )
        for s in range(q.samples):
            px, py = x[0, s], x[1, s]
            out_x = px - min(max(px, q.origin_north), high_x)
            out_y = py - min(max(py, q.origin_east), high_y)
            i = min(max((px - q.origin_north) / q.pixel_size - half, zero), np.float32(q.north) - one)
            j = min(max((py - q.origin_east) / q.pixel_size - half, zero), np.float32(q.east) - one)
            i0, j0 = min(np.int32(i), q.north - 2), min(np.int32(j), q.east - 2)
            a, b = i - np.float32(i0), j - np.float32(j0)
            low = q.chart[i0, j0, 0] + b * (q.chart[i0, j0 + 1, 0] - q.chart[i0, j0, 0])
            high = q.chart[i0 + 1, j0, 0] + b * (q.chart[i0 + 1, j0 + 1, 0] - q.chart[i0 + 1, j0, 0])
            c[0, s] = low + a * (high - low) - np.sqrt(out_x * out_x + out_y * out_y) - q.chart_error
            low = q.chart[i0, j0, 1] + b * (q.chart[i0, j0 + 1, 1] - q.chart[i0, j0, 1])
            high = q.chart[i0 + 1, j0, 1] + b * (q.chart[i0 + 1, j0 + 1, 1] - q.chart[i0 + 1, j0, 1])
            c[1, s] = one - low - a * (high - low)
        excess = price = zero
        for s in range(q.samples - 1):
            first, last, gap = c[0, s], c[0, s + 1], np.sqrt(d[2, s] + tiny)
            apart, ends = half * (first + last - gap), min(first, last)
            aside = (first * first - last * last + gap * gap) / (two * gap)
            half_chord = np.sqrt(max(first * first - aside * aside, zero) + tiny)
            crossed = min(half_chord, ends) if (aside > zero) & (aside < gap) else ends
            excess += max(q.coast_margin - (crossed if apart > zero else apart), zero)
            price += half * (c[1, s] + c[1, s + 1]) * d[4, s]
        return excess * unit, price

    @compiled
    def obstacles(q, x, t, a, c):
        """Excess; a: positions seen from one sphere; c: least clearance of every segment."""
        c[1] = far
        for m in range(q.obstacles):
            px, py, pz, vx, vy, vz, growth, growth_max, seen, boundary = q.obstacle[m]
            for s in range(q.samples):
                since = t[s] - seen
                a[0, s], a[1, s] = x[0, s] - px - vx * since, x[1, s] - py - vy * since
                a[2, s] = x[2, s] - pz - vz * since
            for s in range(q.samples - 1):
                fx, fy, fz = a[0, s], a[1, s], a[2, s]
                dx, dy, dz = a[0, s + 1] - fx, a[1, s + 1] - fy, a[2, s + 1] - fz
                share = -(fx * dx + fy * dy + fz * dz) / (dx * dx + dy * dy + dz * dz + tiny)
                share = min(max(share, zero), one)
                nx, ny, nz = fx + share * dx, fy + share * dy, fz + share * dz
                grown = min(growth * max(t[s + 1] - seen, zero), growth_max)
                c[1, s] = min(c[1, s], np.sqrt(nx * nx + ny * ny + nz * nz + tiny) - grown - boundary)
        excess = zero
        for s in range(q.samples - 1):
            excess += max(q.obstacle_margin - c[1, s], zero)
        return excess * unit

    @compiled
    def kernel(paths, q):
        """Cost [P] s and violation [P]."""
        cost, violation = np.empty(len(paths), np.float32), np.empty(len(paths), np.float32)
        x, u, d = (
            np.empty((3, q.samples), np.float32),
            np.empty((5, q.samples), np.float32),
            np.empty((5, q.samples), np.float32),
        )
        t, c = np.empty(q.samples, np.float32), np.empty((2, q.samples), np.float32)
        control, way = np.empty(q.controls + 2, np.float32), np.empty((3, q.samples), np.float32)
        segments = np.float32(q.samples - 1)
        for p in range(len(paths)):
            positions(q, paths[p], control, x, way)
            current(q, x, u)
            surge, sway, beaten, steep = kinematics(q, way, u, d, t)
            turn = turns(q, d)
            shore, price = coast(q, x, d, c) if q.north else (zero, zero)
            near = obstacles(q, x, t, u, c)
            w, total = q.weights, surge + sway + turn + shore + near + beaten + steep
            weighted = w[0] * surge + w[1] * sway + w[2] * turn + w[3] * shore + w[4] * near
            weighted += w[5] * beaten + w[6] * steep
            violation[p] = total / segments
            cost[p] = t[-1] - q.depart + q.uncertain_price * price + q.straight * weighted / segments
        return cost, violation

    return kernel
