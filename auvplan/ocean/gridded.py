"""Currents on a grid, as ocean models give them: linear in north, east, depth and time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from auvplan.errors import AuvplanError
from auvplan.ocean.currents import Velocity
from auvplan.ocean.deviation import interpolation_deviation
from auvplan.ocean.interpolation import interpolated
from auvplan.runtime.arguments import numbers
from auvplan.runtime.packed import Packable, Packed, is_one, sizes
from auvplan.runtime.pytree import register_without_init

#: Times that are off even ones by less than this share of a step are even.
_EVEN = 1e-4
#: Single precision must resolve steps of depth and time to this share of them.
_RESOLVED = 0.01
#: No current is as fast, m/s: what is, is a fill value or in other units.
_TOO_FAST = 100.0


class CurrentError(AuvplanError):
    """A current that cannot be read or used; the message is one line that names what is wrong."""


@register_without_init
@dataclass(frozen=True, eq=False)
class GriddedCurrent(Packable):
    """A current on a grid of even metres north and east, rising depths and rising times.

    Make one with `from_arrays`. Beyond the grid's edges, first and last level, first and last time, the
    nearest holds; `covers` says where that is. Differentiable in place and time, and in u, v and w.

    Attributes:
        u, v, w: [T, Z, X, Y] m/s north, east, down; w is None where there is no vertical velocity.
        water: [Z, X, Y] bool, where the data has a current. Below the last water of a column, where the sea
            bed may lie anywhere down to the next depth, u, v and w hold what that water has; deeper, and on
            land, what the nearest water of that depth has, or else the water above.
        origin: [2] m, north and east of node (0, 0).
        spacing: [2] m, north and east, between nodes.
        depths: [Z] m, positive down.
        times: [T] s since the epoch.
        step: s between times, or None where they are not even.
    """

    u: jax.Array
    v: jax.Array
    w: jax.Array | None
    water: jax.Array
    origin: jax.Array
    spacing: jax.Array
    depths: jax.Array
    times: jax.Array
    step: jax.Array | None
    gradual = True

    @classmethod
    def from_arrays(
        cls,
        u: ArrayLike,
        v: ArrayLike,
        w: ArrayLike | None = None,
        *,
        origin: tuple[float, float] = (0.0, 0.0),
        spacing: float | tuple[float, float],
        depths: ArrayLike = (0.0,),
        times: ArrayLike = (0.0,),
    ) -> Self:
        """Return a current from its values at the nodes.

        Args:
            u, v, w: [T, Z, X, Y] m/s north, east, down; X counts north, Y east. NaN or masked where there is
                no water; what is so at one time is taken to be so at all.
            origin: m, north and east of node (0, 0).
            spacing: m between nodes, one for both directions or north and east.
            depths: [Z] m, rising, positive down.
            times: [T] s since the epoch, or `numpy.timedelta64` since it, rising.

        Raises:
            CurrentError: something is no number, shapes do not fit, an axis does not rise or is too far from
                zero for single precision, there is no current anywhere, or one that is faster than any is.

        Example:
            >>> import numpy as np
            >>> east = np.broadcast_to(np.arange(3.0), (1, 1, 2, 3))
            >>> field = GriddedCurrent.from_arrays(0 * east, east, spacing=100.0)
            >>> [float(c) for c in field(50.0, 150.0, 0.0, 0.0)]
            [0.0, 1.5, 0.0]
        """
        given = {"u": u, "v": v} | ({} if w is None else {"w": w})
        fields = [_numbers(values, name, np.float32) for name, values in given.items()]
        shape = fields[0].shape
        if len(shape) != 4 or 0 in shape or any(values.shape != shape for values in fields):
            shapes = ", ".join(str(values.shape) for values in fields)
            raise CurrentError(f"u, v and w must be [T, Z, X, Y] and of one shape, got {shapes}")
        axes = [_axis(depths, "depths", shape[1]), _axis(times, "times", shape[0])]
        apart, corner = _pair(spacing, "spacing"), _pair(origin, "origin")
        if not (apart > 0.0).all():
            raise CurrentError(f"spacing must be positive, got {spacing}")
        water = np.logical_and.reduce([np.isfinite(values).all(axis=0) for values in fields])
        if not water.any():
            raise CurrentError("the current has no value anywhere")
        fastest = max(
            float(end)
            for values in fields
            for end in (values.max(where=water, initial=0.0), -values.min(where=water, initial=0.0))
        )
        if fastest > _TOO_FAST:
            raise CurrentError(
                f"the current reaches {fastest:g} m/s, which none does: give m/s, and NaN or a mask where "
                "there is no water"
            )
        level, north, east = _nearest_water(water, apart)
        filled = [jnp.asarray(values[:, level, north, east]) for values in fields]
        first, last, count = axes[1][0], axes[1][-1], len(axes[1])
        mean = (last - first) / (count - 1) if count > 1 else 1.0
        even = np.abs(np.linspace(first, last, count) - axes[1]).max() <= _EVEN * mean
        step = jnp.asarray(mean, jnp.float32) if even else None
        single = partial(jnp.asarray, dtype=jnp.float32)
        places = single(corner), single(apart), single(axes[0]), single(axes[1])
        down = None if w is None else filled[2]
        return cls(filled[0], filled[1], down, jnp.asarray(water), *places, step)

    @property
    def steady(self) -> bool:
        """Whether there is one time only."""
        return is_one(sizes(self.u, 4)[0])

    @property
    def barotropic(self) -> bool:
        """Whether there is one depth only."""
        return is_one(sizes(self.u, 4)[1])

    def grids(self) -> dict[str, tuple[int, int]]:
        """See `Packable.grids`."""
        return {"u": (4, 4), "v": (4, 4), "water": (3, 3), "depths": (1, 1), "times": (1, 1)} | (
            {} if self.w is None else {"w": (4, 4)}
        )

    @cached_property
    def packed(self) -> Self:
        """See `Packable.packed`. Of even times there is the first alone: how many there are, `u` says."""
        found = super().packed
        if self.step is None or found is self:
            return found
        return replace(found, times=Packed.of(np.asarray(self.times)[:1], 1))

    @property
    def fastest(self) -> float:
        """Largest level speed at a node with water, m/s."""
        squared = np.asarray(self.u) ** 2 + np.asarray(self.v) ** 2
        return float(np.sqrt(np.where(np.asarray(self.water), squared, 0.0).max()))

    def covers(self, x: ArrayLike, y: ArrayLike, t: ArrayLike) -> NDArray[np.bool_]:
        """Return whether places and times lie within the grid, in NumPy.

        A steady current holds at all times.
        """
        first = np.asarray(self.origin)
        last = first + np.asarray(self.spacing) * (np.asarray(self.u.shape[-2:]) - 1)
        slack = 1e-3 * np.asarray(self.spacing)
        inside = np.ones(np.broadcast_shapes(*map(np.shape, (x, y, t))), bool)
        for axis, value in enumerate((x, y)):
            inside &= (np.asarray(value) >= first[axis] - slack[axis]) & (
                np.asarray(value) <= last[axis] + slack[axis]
            )
        if not self.steady:
            inside &= (np.asarray(t) >= float(self.times[0])) & (np.asarray(t) <= float(self.times[-1]))
        return inside

    def window(self, first: float, last: float) -> Self:
        """Return the same current at the times that a mission from `first` to `last` [s] meets.

        Where times are even, their number follows from the length of the mission alone: one program serves
        all departures. What follows on `last` holds on.
        """
        if self.steady:
            return self
        times, slack = np.asarray(self.times, float), 1e-6 * (last - first)
        begin = max(int(np.searchsorted(times, first + slack, side="right")) - 1, 0)
        end = min(int(np.searchsorted(times, last - slack)), len(times) - 1)
        step = float(times[-1] - times[-2]) if self.step is None else float(self.step)
        count = end + 1 - begin if self.step is None else int(np.ceil((last - first) / step - 1e-6)) + 2
        index = begin + np.arange(max(count, 2))
        kept = np.minimum(index, end)
        later = (index - kept) * step
        chosen = {
            name: np.asarray(values)[kept]
            for name in ("u", "v", "w")
            if (values := getattr(self, name)) is not None
        }
        return replace(self, **chosen, times=np.asarray(times[kept] + later, np.float32))

    def __call__(self, x: ArrayLike, y: ArrayLike, z: ArrayLike, t: ArrayLike) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        given = [jnp.asarray(axis, jnp.result_type(float)) for axis in (x, y, z, t)]
        shape = jnp.broadcast_shapes(*(axis.shape for axis in given))
        places = tuple(jnp.broadcast_to(axis, shape).reshape(-1) for axis in given)
        grid = self.packed
        fields = (grid.u, grid.v) if grid.w is None else (grid.u, grid.v, grid.w)
        axes = grid.origin, grid.spacing, grid.depths, grid.times, grid.step
        found = [component.reshape(shape) for component in interpolated(fields, axes, places)]
        u, v, w = found if self.w is not None else (*found, jnp.zeros_like(found[0]))
        return u, v, w

    def deviation(self, places: Sequence[ArrayLike], edges: Sequence[ArrayLike]) -> NDArray[np.floating]:
        """Bound the departure from means within boxes, see `auvplan.ocean.deviation`."""
        x, y, z, t = (np.asarray(part, float) for part in places)
        dx, dy, dz, dt = edges
        parts = [np.asarray(part) for part in (self.u, self.v, self.w) if part is not None]
        lines = [
            np.asarray(self.times, float),
            np.asarray(self.depths, float),
            *(
                float(corner) + float(gap) * np.arange(count)
                for corner, gap, count in zip(self.origin, self.spacing, parts[0].shape[2:], strict=True)
            ),
        ]
        return interpolation_deviation(parts, lines, (t, z, x, y), (dt, dz, dx, dy))


def _numbers(values: ArrayLike, name: str, dtype: type = float) -> NDArray[np.floating]:
    try:
        return numbers(name, values, dtype, durations=name == "times")
    except (TypeError, ValueError) as error:
        raise CurrentError(str(error)) from None


def _axis(values: ArrayLike, name: str, size: int) -> NDArray[np.floating]:
    """Depths or times, [size], that single precision distinguishes."""
    axis = _numbers(values, name).reshape(-1)
    if len(axis) != size or not np.isfinite(axis).all() or (np.diff(axis) <= 0.0).any():
        raise CurrentError(f"{name} must be {size} finite rising numbers, got {_brief(axis)}")
    rounding = float(np.spacing(np.float32(np.abs(axis).max())))
    if size > 1 and rounding > _RESOLVED * np.diff(axis).min():
        raise CurrentError(
            f"{name} {_brief(axis)} are too far from zero for steps of {np.diff(axis).min():g}: "
            "count them from nearer"
        )
    return axis


def _pair(values: ArrayLike, name: str) -> NDArray[np.floating]:
    """Two finite numbers, or one for both."""
    pair = _numbers(values, name)
    if pair.shape not in ((), (1,), (2,)) or not np.isfinite(pair).all():
        raise CurrentError(f"{name} must be two finite numbers, north and east, got {values}")
    return np.broadcast_to(pair, (2,))


def _nearest_water(water: NDArray[np.bool_], spacing: NDArray[np.floating]) -> NDArray[np.int_]:
    """Index [3, Z, X, Y], level, north, east, of the water whose values stand at each node."""
    index = np.indices(water.shape)
    for k, wet in enumerate(water):
        if wet.any():
            index[1:, k] = np.asarray(
                scipy.ndimage.distance_transform_edt(
                    ~wet, sampling=spacing, return_distances=False, return_indices=True
                )
            )
        elif k:
            index[:, k] = index[:, k - 1]
        if k:
            ends = water[k - 1] & ~wet
            index[:, k, ends] = index[:, k - 1, ends]
    first = int(np.argmax(water.any(axis=(1, 2))))
    index[:, :first] = index[:, first, None]
    return index


def _brief(axis: NDArray[np.floating]) -> str:
    return str(axis.tolist()) if len(axis) <= 4 else f"{len(axis)} from {axis[0]:g} to {axis[-1]:g}"
