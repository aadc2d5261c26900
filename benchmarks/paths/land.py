"""Land of the random waters: masks of water on a unit square, made of noise or cropped from real charts.

Every mask is [PIXELS, PIXELS], True in water, indexed [north, east]; pixel (i, j) has its centre at
((i + 0.5) / PIXELS, (j + 0.5) / PIXELS). Ends are start and goal, [2, 2], on the same unit square.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.whitsunday import classes
from benchmarks.harness import Array, Rng
from benchmarks.paths.problems import PIXELS, SITES, classes_of, have_charts

Mask = NDArray[np.bool_]

#: Waves that make up the outline of a wall, a channel or an island.
_WAVES = 6

#: Pixels of a real chart to a pixel of a crop.
_ZOOM = 0.8, 1.7

#: Least and greatest share of land on a crop.
_LAND = 0.05, 0.75

#: Way from start to goal, in units of the square, that every family keeps at least.
_APART = 0.55


def open_water(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return no land at all, and ends anywhere.

    Args:
        gap: least width of a passage, in units of the square; the other families keep it.
    """
    return np.ones((PIXELS, PIXELS), bool), _far_apart(rng)


def coast(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return a piece of a real chart, turned by any angle and mirrored at random.

    The shipped chart stands in where the shared ones are absent.
    """
    kinds = classes_of(SITES[rng.integers(len(SITES))]) if have_charts() else classes()[::-1]
    water = (kinds == 2) if rng.random() < 0.5 else (kinds > 0)
    while True:
        mask = _cropped(rng, water)
        if _LAND[0] <= 1.0 - mask.mean() <= _LAND[1]:
            return mask, _far_apart(rng)


def _cropped(rng: Rng, water: Mask) -> Mask:
    """Return a square of a chart, anywhere and at any angle."""
    zoom, angle = rng.uniform(*_ZOOM), rng.uniform(0.0, 2.0 * np.pi)
    turn = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    reach = 0.5 * PIXELS * zoom * (abs(np.cos(angle)) + abs(np.sin(angle)))
    centre = [rng.uniform(reach, side - reach) for side in water.shape]
    offset = centre - turn @ np.full(2, 0.5 * PIXELS)
    part = ndimage.affine_transform(
        water.astype(np.uint8), turn, offset, (PIXELS, PIXELS), order=0, mode="nearest"
    )
    mask = part.astype(bool)
    return np.ascontiguousarray(mask[::-1] if rng.random() < 0.5 else mask)


def island(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return one island across the way, wider than the way is free to either side, and a few islets."""
    x, y = _places()
    heading = rng.uniform(0.0, 2.0 * np.pi)
    ahead = np.array([np.cos(heading), np.sin(heading)])
    aside = np.array([-ahead[1], ahead[0]])
    distance = rng.uniform(_APART, 0.85)
    middle = 0.5 + rng.uniform(-0.06, 0.06, 2)
    ends = middle + distance * np.array([[-0.5], [0.5]]) * ahead
    centre = middle + rng.uniform(-0.12, 0.12) * ahead + rng.uniform(-0.15, 0.15) * aside
    along = (x - centre[0]) * ahead[0] + (y - centre[1]) * ahead[1]
    across = (x - centre[0]) * aside[0] + (y - centre[1]) * aside[1]
    long, thick = rng.uniform(0.18, 0.36), rng.uniform(0.04, 0.13)
    bearing = np.arctan2(along / thick, across / long)
    outline = 1.0 + sum(
        rng.uniform(0.0, 0.5) / k * np.cos(k * bearing + rng.uniform(0.0, 2.0 * np.pi))
        for k in range(2, _WAVES + 2)
    )
    water = np.hypot(along / thick, across / long) > outline
    for _ in range(rng.integers(0, 8)):
        islet, radius = rng.uniform(0.05, 0.95, 2), np.exp(rng.uniform(np.log(0.005), np.log(0.04)))
        if np.linalg.norm(ends - islet, axis=1).min() > radius + 2.0 * gap:
            water &= np.hypot(x - islet[0], y - islet[1]) > radius
    return water, ends


def sounds(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return two or three walls across the way with one or two narrow gaps each, or a winding channel."""
    x, y = _places()
    ends = np.array(
        [[rng.uniform(0.04, 0.1), rng.uniform(0.15, 0.85)], [rng.uniform(0.9, 0.96), rng.uniform(0.15, 0.85)]]
    )
    if rng.random() < 0.3:
        water = _channel(rng, x, y, ends, gap)
    else:
        water = np.ones(x.shape, bool)
        count = rng.integers(2, 4)
        for k in range(count):
            middle = 0.2 + 0.6 * (k + rng.uniform(0.2, 0.8)) / count
            water &= _wall(rng, x, y, middle, rng.uniform(gap, max(1.3 * gap, 0.026), rng.integers(1, 3)))
    return _turned(rng, water, ends)


def fjords(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return branching inlets: a random spanning tree of corridors, bent by noise, with a few loops."""
    cells = int(rng.integers(4, max(5, min(9, int(1.0 / (2.6 * gap)) + 1))))
    parent = _spanning_tree(rng, cells)
    edges = [(node, up) for node, up in enumerate(parent) if up >= 0]
    degree = np.bincount(np.ravel(edges), minlength=cells * cells)
    for _ in range(rng.integers(0, cells)):
        i, j = rng.integers(0, cells - 1), rng.integers(0, cells)
        pair = (
            (i * cells + j, (i + 1) * cells + j) if rng.random() < 0.5 else (j * cells + i, j * cells + i + 1)
        )
        edges.append(pair)
    x, y = _places()
    bend = 0.22 / cells
    bent_x, bent_y = x + bend * _noise(rng, cells), y + bend * _noise(rng, cells)
    nodes = (np.stack(np.divmod(np.arange(cells * cells), cells), axis=1) + 0.5) / cells
    water = np.zeros(x.shape, bool)
    for a, b in edges:
        width = rng.uniform(max(1.35 * gap, 0.22 / cells), max(1.6 * gap, 0.5 / cells))
        way = nodes[b] - nodes[a]
        share = ((bent_x - nodes[a, 0]) * way[0] + (bent_y - nodes[a, 1]) * way[1]) / (way @ way)
        share = np.clip(share, 0.0, 1.0)
        away = np.hypot(bent_x - nodes[a, 0] - share * way[0], bent_y - nodes[a, 1] - share * way[1])
        water |= away < 0.5 * width
    leaves = np.flatnonzero(degree == 1)
    first = rng.choice(leaves)
    apart = np.linalg.norm(nodes[leaves] - nodes[first], axis=1)
    far = leaves[apart >= min(_APART, apart.max())]
    # The bend moves a node's place: the ends are where the bent coordinates equal the node's.
    pair = nodes[[first, rng.choice(far)]]
    nearest = [np.argmin((bent_x - node[0]) ** 2 + (bent_y - node[1]) ** 2) for node in pair]
    return water, (np.stack(np.divmod(nearest, PIXELS), axis=1) + 0.5) / PIXELS


def gates(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return a wall across the way with two or three wide gaps, or an island: ways that others may close."""
    if rng.random() < 0.4:
        return island(rng, gap)
    x, y = _places()
    ends = np.array(
        [[rng.uniform(0.05, 0.15), rng.uniform(0.2, 0.8)], [rng.uniform(0.85, 0.95), rng.uniform(0.2, 0.8)]]
    )
    count, places = rng.integers(2, 4), []
    while len(places) < count:
        place = rng.uniform(0.1, 0.9)
        if all(abs(place - other) > 0.2 for other in places):
            places.append(place)
    wide = max(1.5 * gap, 0.03)
    water = _wall(rng, x, y, rng.uniform(0.35, 0.65), rng.uniform(wide, 2.5 * wide, count), places)
    return _turned(rng, water, ends)


def closed(rng: Rng, gap: float) -> tuple[Mask, Array]:
    """Return a wall without a gap, or a ring of land around the goal."""
    x, y = _places()
    if rng.random() < 0.5:
        ends = np.array([[rng.uniform(0.05, 0.2), rng.uniform(0.1, 0.9)], [0.9, rng.uniform(0.1, 0.9)]])
        return _turned(rng, _wall(rng, x, y, rng.uniform(0.4, 0.6), []), ends)
    ends = _far_apart(rng)
    away = np.hypot(x - ends[1, 0], y - ends[1, 1])
    radius = rng.uniform(0.1, 0.3)
    thick = rng.uniform(0.02, 0.06)
    return np.abs(away - radius) > 0.5 * thick, ends


def _places() -> tuple[Array, Array]:
    """Return x and y of the pixels' centres, [PIXELS, PIXELS]."""
    line = (np.arange(PIXELS) + 0.5) / PIXELS
    return tuple(np.meshgrid(line, line, indexing="ij"))


def _far_apart(rng: Rng) -> Array:
    """Return start and goal anywhere, `_APART` from each other at least."""
    while True:
        ends = rng.uniform(0.05, 0.95, (2, 2))
        if np.linalg.norm(ends[1] - ends[0]) >= _APART:
            return ends


def _turned(rng: Rng, water: Mask, ends: Array) -> tuple[Mask, Array]:
    """Mirror and transpose mask and ends at random."""
    if rng.random() < 0.5:
        water, ends = water[::-1], np.stack([1.0 - ends[:, 0], ends[:, 1]], axis=1)
    if rng.random() < 0.5:
        water, ends = water.T, ends[:, ::-1]
    return np.ascontiguousarray(water), ends


def _wave(rng: Rng, share: Array) -> Array:
    """Return smooth noise along a line, within about -1 and 1, of the shape of `share` in [0, 1]."""
    total = np.zeros_like(share)
    for k in range(1, _WAVES + 1):
        total += rng.normal() / k * np.cos(np.pi * k * share + rng.uniform(0.0, 2.0 * np.pi))
    return total / 2.0


def _noise(rng: Rng, cells: int) -> Array:
    """Return smooth noise of unit deviation whose waves are as long as a cell or two, [PIXELS, PIXELS]."""
    field = ndimage.gaussian_filter(rng.normal(size=(PIXELS, PIXELS)), 0.6 * PIXELS / cells, mode="wrap")
    return field / field.std()


def _wall(
    rng: Rng, x: Array, y: Array, middle: float, gaps: Array | list, places: list[float] | None = None
) -> Mask:
    """Return the water beside a wobbling wall across x = `middle`, and in its gaps of the given widths."""
    line = middle + 0.05 * _wave(rng, y)
    half = 0.5 * (rng.uniform(0.02, 0.05) + 0.02 * np.abs(_wave(rng, y)))
    water = np.abs(x - line) > half
    for k, width in enumerate(gaps):
        place = rng.uniform(0.06, 0.94) if places is None else places[k]
        water |= np.abs(y - place) < 0.5 * width
    return water


def _channel(rng: Rng, x: Array, y: Array, ends: Array, gap: float) -> Mask:
    """Return a winding channel from start to goal between margins, narrow in places."""
    share = np.clip((x - ends[0, 0]) / (ends[1, 0] - ends[0, 0]), 0.0, 1.0)
    swing = rng.uniform(0.05, 0.2) * _wave(rng, share) * np.sin(np.pi * share)
    line = ends[0, 1] + share * (ends[1, 1] - ends[0, 1]) + swing
    slant = np.hypot(1.0, np.gradient(line[:, 0], 1.0 / PIXELS))[:, None]
    width = slant * (1.2 * gap + rng.uniform(0.01, 0.06) * _wave(rng, share) ** 2)
    return np.abs(y - line) < 0.5 * np.maximum(width, 1.2 * gap * slant)


def _spanning_tree(rng: Rng, cells: int) -> list[int]:
    """Return the parent of each node of a square lattice in a random tree, -1 for the root.

    A depth-first walk gives long inlets; that it goes on now and then from elsewhere makes them branch.
    """
    parent = [-2] * (cells * cells)
    root = int(rng.integers(cells * cells))
    parent[root], active = -1, [root]
    while active:
        at = len(active) - 1 if rng.random() < 0.7 else int(rng.integers(len(active)))
        node = active[at]
        i, j = divmod(node, cells)
        near = [
            a * cells + b
            for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))
            if 0 <= a < cells and 0 <= b < cells and parent[a * cells + b] == -2
        ]
        if not near:
            active.pop(at)
            continue
        chosen = int(rng.choice(near))
        parent[chosen] = node
        active.append(chosen)
    return parent
