"""Least-energy paths in depth against a dynamic programme: ``python -m benchmarks.energy_depth``.

Twelve seas whose current changes with depth: shear, a jet, an Ekman spiral, opposed layers. The programme
chooses depth and speed at every step along the vertical plane between the ends; the planner chooses a path in
space and one speed. One walk in short steps says what both take. See `docs/energy.md`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import auvplan as ap
from auvplan.energy import PowerLaw, PowerModel, PowerTable
from auvplan.path import plan_least_energy, speeds_along
from benchmarks.harness import Array, clock, launch, show_markdown, track

KINDS = "shear", "jet", "Ekman spiral", "opposed layers"
#: m/s: least and greatest speed, and the one that a scenario might state.
SPEEDS, USUAL = (0.3, 2.5), 1.5
#: m along and in depth, steps of the dynamic programme; speeds that it chooses from, and strengths of the
#: current between which it interpolates what moves take.
STEPS, CHOICES, STRENGTHS = (10.0, 0.25), 60, 7
#: Places on a move at which the current is met, and metres of steps that tracks are walked in.
PLACES, WALK = 6, 2.0
#: Plans of each kind, the quickest of which counts.
TIMED = 3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Sheared:
    """A current that changes with depth, and in strength along the way."""

    base: Any  # [2] m/s
    shear: Any  # [2] m/s per m of depth
    jet: Any  # [2] m/s, strength and direction
    layers: Any  # [2] m/s, strength and direction
    spiral: Any  # [2] m/s, strength and direction
    # [5] m, the jet's depth and thickness, the boundary of layers and its thickness, Ekman's depth
    depths: Any
    wave: Any  # amplitude of the strength along the way, and m, its length

    steady = True

    def __call__(self, x: Any, y: Any, z: Any, t: Any) -> tuple[Any, Any, Any]:
        """Return u, v, w, m/s; arrays of JAX or of NumPy, as places are."""
        xp: Any = jnp if isinstance(z, jax.Array) else np
        middle, thick, border, blurred, ekman = (self.depths[k] for k in range(5))
        hump, side = xp.exp(-(((z - middle) / thick) ** 2)), xp.tanh((z - border) / blurred)
        fade, turn = xp.exp(-z / ekman), z / ekman
        (p, q), cos, sin = (self.spiral[0], self.spiral[1]), xp.cos(turn), xp.sin(turn)
        turned = fade * (p * cos - q * sin), fade * (p * sin + q * cos)
        strength = self.strength(x)
        u, v = (
            strength
            * (self.base[k] + self.shear[k] * z + self.jet[k] * hump + self.layers[k] * side + turned[k])
            for k in (0, 1)
        )
        return u, v, 0.0 * u

    def strength(self, x: Any) -> Any:
        """Return the factor on the current by metres along the way."""
        xp: Any = jnp if isinstance(x, jax.Array) else np
        return 1.0 + self.wave[0] * xp.sin(2.0 * np.pi * x / self.wave[1])


@dataclass(frozen=True)
class Sea:
    """One of the twelve: a leg to the north in a box, and what the vehicle draws."""

    name: str
    current: Sheared
    distance: float
    bottom: float
    depths: tuple[float, float]
    power: PowerModel

    @property
    def leg(self) -> tuple[Array, Array, ap.Environment]:
        """Start and goal, [3] m each, and the world."""
        ends = np.array([0.0, 0.0, self.depths[0]]), np.array([self.distance, 0.0, self.depths[1]])
        aside = 0.5 * self.distance
        low, high = (-aside, -aside, 0.0), (self.distance + aside, aside, self.bottom)
        return *ends, ap.Environment(jax.tree.map(jnp.asarray, self.current), lower=low, upper=high)


def seas(seed: int) -> list[Sea]:
    """Draw three seas of each kind; in the last of each the current changes along the way too."""
    rng, found = np.random.default_rng(seed), []
    for number in range(12):
        kind = KINDS[number % 4]
        distance, bottom = 100.0 * rng.integers(10, 51), 10.0 * rng.integers(5, 21)
        strong, sign = rng.uniform(0.2, 0.6), rng.choice([-1.0, 1.0], p=[0.3, 0.7])
        heading = rng.uniform(-0.6, 0.6)
        ahead = strong * np.array([np.cos(heading), np.sin(heading)])
        none = np.zeros(2)
        parts = dict.fromkeys(("shear", "jet", "layers", "spiral"), none)
        parts |= {"base": rng.uniform(-0.15, 0.15, 2)}
        depths = np.array([
            rng.uniform(0.3, 0.8) * bottom, rng.uniform(0.1, 0.25) * bottom,
            rng.uniform(0.3, 0.7) * bottom, rng.uniform(0.05, 0.2) * bottom, rng.uniform(0.15, 0.4) * bottom,
        ])  # fmt: skip
        match kind:
            case "shear":
                parts |= {"base": parts["base"] - 0.5 * sign * ahead, "shear": sign * ahead / bottom}
            case "jet":
                parts["jet"] = ahead
            case "Ekman spiral":
                parts["spiral"] = -sign * ahead
            case _:
                parts["layers"] = 0.7 * sign * ahead
        wave = np.array([rng.uniform(0.2, 0.5) if number >= 8 else 0.0, distance / rng.uniform(1.0, 3.0)])
        ends = 0.0, 0.0 if number % 3 else 5.0 * rng.integers(1, bottom // 5)
        dive, climb = rng.uniform(50.0, 400.0, 2)
        law = PowerLaw(0.0, 20.0)
        if number == 5:
            law = PowerTable([0.0, 0.5, 0.8, 1.1, 1.4, 1.8, 2.5], [0.0, 4.0, 13.0, 30.0, 56.0, 120.0, 310.0])
        power = PowerModel(law, hotel=40.0, dive=dive, climb=climb)
        found.append(Sea(kind, Sheared(**parts, depths=depths, wave=wave), distance, bottom, ends, power))
    return found


def walked(sea: Sea, places: Array, speeds: Array | float) -> float:
    """Energy of a track through places [K, 3] m at speeds [K - 1] or one, m/s, in short steps, J."""
    way = np.diff(places, axis=0)
    gap = np.linalg.norm(way, axis=1)
    parts = np.maximum(np.ceil(gap / WALK), 1.0).astype(int)
    k = np.repeat(np.arange(len(gap)), parts)
    share = (np.arange(len(k)) - np.repeat(np.cumsum(parts) - parts, parts) + 0.5) / parts[k]
    x, y, z = (places[k] + share[:, None] * way[k]).T
    speed = np.broadcast_to(speeds, gap.shape)[k]
    u, v, _ = sea.current(x, y, z, 0.0)
    north, east = (way[k, :2] / gap[k][:, None]).T
    along = u * north + v * east
    ground = along + np.sqrt(speed**2 - (u * u + v * v - along**2))
    seconds = gap[k] / parts[k] / ground
    drawn = np.asarray(sea.power.power(speed), float)
    dived = sea.power.dive * np.maximum(way[:, 2], 0.0) + sea.power.climb * np.maximum(-way[:, 2], 0.0)
    return float((drawn * seconds).sum() + dived.sum())


@dataclass(frozen=True)
class Programme:
    """Moves between depths over one step along the way, and what they take."""

    step: tuple[float, float]  # m along and in depth
    depths: Array  # [J] m
    jumps: NDArray[np.int_]  # [B], levels by which a move changes depth
    strengths: Array  # [G], of the current
    energy: Array  # [G, V, J, B] J; infinite beyond the box and the limit on pitch
    speeds: Array  # [V] m/s

    @classmethod
    def of(cls, sea: Sea, step: tuple[float, float], pitch: float) -> "Programme":
        ahead, fine = step
        depths = np.arange(round(sea.bottom / fine) + 1) * fine
        reach = round(1.5 * ahead / fine)
        jumps = np.arange(-reach, reach + 1)
        least, most = 1.0 - sea.current.wave[0], 1.0 + sea.current.wave[0]
        strengths = np.linspace(least, most, STRENGTHS) if most > least else np.ones(1)
        speeds = np.geomspace(*SPEEDS, CHOICES)
        drawn = np.asarray(sea.power.power(speeds), float)
        rise = jumps * fine
        gap = np.hypot(ahead, rise)
        middles = depths[:, None, None] + rise[:, None] * (np.arange(PLACES) + 0.5) / PLACES
        u, v, _ = sea.current(np.zeros(()), 0.0, middles, 0.0)
        energy = np.empty((len(strengths), len(speeds), len(depths), len(jumps)), np.float32)
        inside = (depths[:, None] + rise >= -1e-6) & (depths[:, None] + rise <= sea.bottom + 1e-6)
        dived = sea.power.dive * np.maximum(rise, 0.0) + sea.power.climb * np.maximum(-rise, 0.0)
        slope = rise / gap
        for g, strength in enumerate(strengths):
            along = strength * u * (ahead / gap)[:, None]
            beside = strength**2 * (u * u + v * v) - along**2
            for k, speed in enumerate(speeds):
                ground = along + np.sqrt(np.maximum(speed**2 - beside, 0.0))
                kept = (ground > 0.05 * speed) & (beside < speed**2)
                kept &= np.abs(ground * slope[:, None]) <= speed * np.sin(pitch)
                seconds = gap * (1.0 / np.maximum(ground, 1e-3)).mean(axis=2)
                energy[g, k] = np.where(kept.all(axis=2) & inside, drawn[k] * seconds + dived, np.inf)
        return cls(step, depths, jumps, strengths, energy, speeds)

    def solve(self, sea: Sea, energy: Array, choice: Array | None = None) -> tuple[float, Array, Array]:
        """Return the least energy, J, its track [K, 3] m and the speed [K - 1] of each move, m/s.

        Args:
            sea: that moves are in.
            energy: [G, J, B] J of moves.
            choice: [G, J, B], the speed of each; None where all have the same.
        """
        steps, count = round(sea.distance / self.step[0]), len(self.depths)
        first, last = (round(depth / self.step[1]) for depth in sea.depths)
        row, column = np.arange(count), np.arange(len(self.jumps))
        origin = row[:, None] - self.jumps
        outside, origin = (origin < 0) | (origin >= count), np.clip(origin, 0, count - 1)
        cost = np.where(row == first, 0.0, np.inf)
        back, near = np.empty((steps, count), int), np.empty(steps, int)
        for i in range(steps):
            strength = float(sea.current.strength(self.step[0] * (i + 0.5)))
            place = float(np.interp(strength, self.strengths, np.arange(len(self.strengths))))
            low = min(int(place), max(len(self.strengths) - 2, 0))
            part, near[i] = place - low, round(place)
            moves = energy[low]
            if part:
                with np.errstate(invalid="ignore"):
                    moves = moves + part * (energy[low + 1] - moves)
                moves = np.where(np.isfinite(moves), moves, np.inf)
            # Arrivals at each level, by the jump that ends there.
            total = np.where(outside, np.inf, cost[origin] + moves[origin, column])
            back[i] = np.argmin(total, axis=1)
            cost = total[row, back[i]]
        if not np.isfinite(cost[last]):
            return np.inf, np.zeros((0, 3)), np.zeros(0)
        level, levels, chosen = last, [last], []
        for i in reversed(range(steps)):
            jump = back[i, level]
            level = level - self.jumps[jump]
            levels.append(level)
            chosen.append(0 if choice is None else choice[near[i], level, jump])
        x = self.step[0] * np.arange(steps + 1)
        places = np.stack([x, 0.0 * x, self.depths[levels[::-1]]], axis=1)
        return float(cost[last]), places, self.speeds[np.asarray(chosen[::-1], int)]

    def free(self, sea: Sea) -> tuple[Array, Array]:
        """Return the track of least energy where each move has a speed of its own, and these."""
        return self.solve(sea, self.energy.min(axis=1), self.energy.argmin(axis=1))[1:]

    def single(self, sea: Sea) -> tuple[Array, float]:
        """Return the track of least energy at one speed, and that."""
        found = [self.solve(sea, self.energy[:, k])[:2] for k in range(len(self.speeds))]
        best = int(np.argmin([cost for cost, _ in found]))
        return found[best][1], float(self.speeds[best])


#: A sea, and what was found there: energies in J by the same walk.
COLUMNS = {
    "sea": "{sea}", "km": "{km:.1f}", "depth from, to, m": "{depths[0]:.0f}, {depths[1]:.0f} of {bottom:.0f}",
    "programme, kJ": "{kilojoules:.1f}",
    "planner / programme, speeds by segment": "{ratio:.4f}, {varied_ratio:.4f}",
    "speed, programme's, m/s": "{speed:.2f}, {speeds[0]:.2f}-{speeds[1]:.2f}",
    "deepest, programme's, m": "{deepest[1]:.0f}, {deepest[0]:.0f}",
    "saved: quickest path, 1.5 m/s": "{saved[0]:.1%}, {saved[1]:.1%}",
    "s a plan, fixed speed": "{seconds:.2f}, {fixed:.2f}",
}  # fmt: skip


def compared(sea: Sea, seed: int) -> dict[str, Any]:
    """Plan in a sea, and solve it by the programme.

    Returns:
        Energies of the dynamic `programme`, on a grid twice as `coarse`, and there at one speed, `single`; of
        the planner's path, `planned`, and `varied` where each of its segments has its best speed; and shares
        `saved` against the quickest path at its best speed and at `USUAL`. `seconds` of a plan, `fixed` at a
        given speed; `tracks` of the programme and the planner.
    """
    vehicle, key = ap.Vehicle(USUAL, power=sea.power), jax.random.key(seed)
    pitch = float(np.asarray(vehicle.pitch_max))
    coarse, fine = (Programme.of(sea, (part * STEPS[0], part * STEPS[1]), pitch) for part in (2.0, 1.0))
    places, speeds = fine.free(sea)

    def planned(vehicle: ap.Vehicle) -> ap.PathPlan:
        return plan_least_energy(*sea.leg, vehicle, key=key, speeds=SPEEDS)

    def fixed(vehicle: ap.Vehicle) -> ap.PathPlan:
        return ap.plan_path(*sea.leg, vehicle, key=key)

    def spent(plan: ap.PathPlan) -> float:
        speed = float(np.asarray(plan.conditions.vehicle.speed))
        return walked(sea, np.asarray(plan.positions, float), speed)

    plan = planned(vehicle)
    own, path = plan.conditions.vehicle, np.asarray(plan.positions, float)
    fixed(own)
    seconds, lasts = (
        min(clock(lambda one=one, given=given: one(given))[0] for _ in range(TIMED))
        for one, given in ((planned, vehicle), (fixed, own))
    )
    # What dives take plays no part in where the quickest paths lead, nor in which speed is best along them.
    quickest = planned(replace(vehicle, power=replace(sea.power, dive=0.0, climb=0.0)))
    programme, takes = walked(sea, places, speeds), spent(plan)
    varied = walked(sea, path, speeds_along(plan, sea.power, limits=SPEEDS)[0])
    return {
        "sea": sea.name, "km": sea.distance / 1000.0, "bottom": sea.bottom, "depths": sea.depths,
        "programme": programme, "kilojoules": programme / 1000.0, "coarse": walked(sea, *coarse.free(sea)),
        "single": walked(sea, *coarse.single(sea)), "planned": takes, "ratio": takes / programme,
        "varied": varied, "varied_ratio": varied / programme,
        "saved": tuple(1.0 - takes / spent(other) for other in (quickest, fixed(vehicle))),
        "speed": float(np.asarray(own.speed)), "speeds": (float(speeds.min()), float(speeds.max())),
        "deepest": (float(places[:, 2].max()), float(path[:, 2].max())), "feasible": plan.feasible,
        "seconds": seconds, "fixed": lasts, "tracks": (places, path),
    }  # fmt: skip


def draw(rows: Sequence[dict[str, Any]], file: Path) -> None:
    import matplotlib.pyplot as plt

    from auvplan.plot import style

    figure, all_axes = plt.subplots(4, 3, figsize=(11, 9), layout="constrained")
    for axes, row in zip(all_axes.flat, rows, strict=False):
        for places, colour, width in zip(row["tracks"], (style.GREY, style.BLUE), (3.0, 1.2), strict=True):
            axes.plot(places[:, 0] / 1000.0, places[:, 2], color=colour, lw=width)
        axes.set(ylim=(row["bottom"], -3.0), xlabel="km", ylabel="depth [m]")
        axes.set_title("{sea}: {ratio:.3f}".format(**row), fontsize=9)
    figure.savefig(file, dpi=120)


@launch(seeds=(range(1, 2), "of the seas, twelve each"), picture=("", "file to draw depths along the way in"))
def main(seeds: range, picture: str) -> dict[str, Any]:
    rows = [compared(sea, seed) for seed in seeds for sea in track(seas(seed), f"seas of seed {seed}")]
    show_markdown(rows, COLUMNS)
    names = "ratio", "varied_ratio", "seconds", "fixed", "coarse", "single", "programme", "saved"
    of = {name: np.array([row[name] for row in rows]) for name in names}
    slower, saved = of["seconds"] / of["fixed"], of["saved"].mean(axis=0)
    found = {
        f"{what}{figure}": getattr(of[name], call)()
        for what, name in (("planner / programme, ", "ratio"), ("speeds by segment, ", "varied_ratio"))
        for figure, call in (("mean", "mean"), ("least", "min"), ("greatest", "max"))
    } | {
        "change of the programme on a grid twice as coarse, greatest":
            np.abs(of["coarse"] / of["programme"] - 1.0).max(),
        "more at one speed, greatest": (of["single"] / of["coarse"]).max() - 1.0,
        "time of a plan / that at a given speed, median": np.median(slower), "greatest": slower.max(),
        "all": of["seconds"].sum() / of["fixed"].sum(),
        "saved against the quickest path at its best speed, mean": saved[0],
        f"saved against the quickest path at {USUAL} m/s, mean": saved[1],
    }  # fmt: skip
    print(f"{sum(row['feasible'] for row in rows)} of {len(rows)} feasible", end="")
    print(*(f"; {name} {value:.4f}" for name, value in found.items()), sep="")
    if picture:
        draw(rows, Path(picture))
    kept = [{name: value for name, value in row.items() if name != "tracks"} for row in rows]
    return {"summary": {name: float(value) for name, value in found.items()}, "rows": kept}
