"""From the colours of a chart picture to passability, by k-means (section 2 of the paper).

The paper clusters a map picture into coast, uncertain area and water. k-means returns its clusters in no
particular order, and how many tones a class has differs from picture to picture. So the picture is cut into
more clusters than there are classes, and each cluster is named: by the colours that the user gives, or by
rules on hue and blueness, both taken in CIELAB, where distance and hue follow what the eye sees.
"""

import hashlib
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from PIL import ImageColor

from auvplan.ocean.frame import edge_of, find_frame, joined, shade_of, surround
from auvplan.ocean.naming import COAST, KINDS, UNCERTAIN, WATER, name, shares
from auvplan.ocean.palette import DEFAULT_COLOURS, ChartColours, blueness, to_hex, to_lab, to_rgb
from auvplan.runtime.cache import kept

UNCERTAIN_MAX = 0.35
"""Highest passability of an uncertain pixel (section 2 of the paper)."""

DEFAULT_CLUSTERS = 8
"""More than the three classes: shaded relief and depth tints give land and water several tones each, and with
three clusters k-means would rather halve a large class than single out a small one."""

_LIGHTNESS_WEIGHT = 0.5  # shading varies lightness within a class; hue distinguishes the classes
_WEIGHT = np.array([_LIGHTNESS_WEIGHT, 1.0, 1.0], np.float32)
_DISTANCE_SCALE = 50.0  # colour distance over which an uncertain pixel's passability falls by 1/e
_SAMPLE = 30_000
_BLOCK_ROWS = 1_000_000

# Signs that a picture is no chart: how far the pixels scatter about their clusters, and how many lie between
# the classes. Charts have up to 4 and half a per cent: one of both is too much by itself, or both together.
_SCATTER_MAX, _BETWEEN_MAX = 6.0, 0.05
_SCATTER_BOTH, _BETWEEN_BOTH = 2.5, 0.01
_LEAST_WATER = 0.02  # share of water within a frame, without which it is none


class Cluster(NamedTuple):
    """Pixels of like colour: #rrggbb of the centre, share of what is shown; coast, uncertain or water."""

    colour: str
    share: float
    kind: str


@dataclass(frozen=True, eq=False)
class Classified:
    """A picture's pixels by what they stand for.

    Attributes:
        passability: [h, w] float32, in the picture's own orientation: 0 coast, (0, 0.35] uncertain, 1 water.
        clusters: the largest first.
        doubts: why the names may be wrong; none where all colours were given.
        notes: what was assumed, a line each.
        warnings: signs that the picture is no chart, or that its colours were named wrongly, a line each.
        outside: [h, w] pixels that show no sea area and reach to the picture's edge: what is no data, and a
            frame of a shade that no colour names.
    """

    passability: NDArray[np.float32]
    clusters: tuple[Cluster, ...]
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    outside: NDArray[np.bool_] | None = None

    def listed(self) -> str:
        """Return the clusters' colours and shares, the largest first."""
        return ", ".join(f"{cluster.colour} {cluster.share:.1%}" for cluster in self.clusters)


def classify_picture(
    rgb: NDArray[np.uint8],
    blank: NDArray[np.bool_] | None = None,
    clusters: int = DEFAULT_CLUSTERS,
    seed: int = 0,
    colours: ChartColours = DEFAULT_COLOURS,
) -> Classified:
    """Return what the pixels of a chart picture stand for.

    A 3 x 3 median takes out single-pixel noise, k-means is fitted on a random subset of the pixels, every
    pixel goes to its nearest cluster, and clusters are named by `auvplan.ocean.naming.name`. The passability
    of an uncertain pixel is ``0.35 exp(-d / 50)`` with d its colour distance from the bluest cluster's
    centre, or where that is no water, from the nearest cluster of water.

    What shows no sea area is coast: pixels that are `blank`, and a black or white frame around the rest.
    Where the picture's place on Earth is known, what of it reaches to the edge lies off the chart.

    Args:
        rgb: the picture, [h, w, 3] uint8.
        blank: [h, w] pixels without data, such as see-through ones.
        clusters: number of clusters; fewer are used where the picture has fewer colours.
        seed: seed of the subset and of k-means.
        colours: what they stand for, as the user gives it.

    Raises:
        ValueError: `rgb` is not such an array, it is empty, or `clusters` is not positive.

    Differences from the paper:
        It names neither the number of clusters nor how the value of an uncertain pixel follows from its
        colour; both are chosen here. Its blue clusters are water; here sea tones far less blue are uncertain,
        and colours can be given where water is not blue.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or rgb.size == 0:
        raise ValueError(f"a picture is a non-empty [h, w, 3] uint8 array, got {rgb.dtype} {list(rgb.shape)}")
    if clusters < 1:
        raise ValueError(f"clusters must be positive, got {clusters}")
    if blank is None:
        blank = np.zeros(rgb.shape[:2], bool)
    digest = hashlib.sha256(rgb.tobytes())
    digest.update(np.packbits(blank).tobytes())
    parts = digest.hexdigest(), f"{rgb.shape} {clusters} {seed} {colours}"
    make = partial(_classified, rgb, clusters, seed, colours, blank)
    return kept("auvplan.ocean.classify", make, *parts, version("scikit-learn"))


def _classified(
    rgb: NDArray[np.uint8], clusters: int, seed: int, colours: ChartColours, blank: NDArray[np.bool_]
) -> Classified:
    """`classify_picture` of what is a picture."""
    if blank.all():
        return Classified(np.zeros(blank.shape, np.float32), (), ("it holds nothing but no data",))
    frame, shade = find_frame(rgb, blank)
    found = _cluster(rgb, clusters, seed, colours, blank | frame)
    if frame.any() and (found.passability == 1.0).sum() < _LEAST_WATER * (~(blank | frame)).sum():
        # What was taken for a frame may be the sea around a rectangle of land.
        frame = np.zeros_like(frame)
        found = _cluster(rgb, clusters, seed, colours, blank)
    notes = tuple(
        f"{what}, {float(part.mean()):.1%} of the picture, shows no sea area and is closed"
        for what, part in (("what is see-through or no data", blank), (f"the {shade} frame", frame))
        if part.any()
    )
    named = {shade_of(np.asarray(ImageColor.getrgb(colour))) for colour in colours.listed()[0]}
    beyond = joined(blank if shade and shade in named else blank | frame, edge_of(blank.shape))
    found = replace(found, notes=(*notes, *found.notes), outside=beyond)
    around = surround(rgb)
    if around and not frame.any() and found.passability[0, 0] == 1.0:
        if colours.complete:
            line = f"is {around} along all four sides, which is taken for water: cut off what is paper"
            return replace(found, warnings=(*found.warnings, line))
        line = f"the {around} along all four sides may be paper as well as water"
        return replace(found, doubts=(*found.doubts, line))
    return found


def _cluster(
    rgb: NDArray[np.uint8], clusters: int, seed: int, colours: ChartColours, blank: NDArray[np.bool_]
) -> Classified:
    """`classify_picture` of the pixels that show something."""
    # Imported here because it takes most of a second, and only pictures need it.
    from sklearn.cluster import KMeans

    smooth = [scipy.ndimage.median_filter(rgb[..., c], size=3, mode="nearest") for c in range(3)]
    pixels = np.stack(smooth, axis=-1).reshape(-1, 3)
    shown = pixels[~blank.ravel()]
    sample = shown[np.random.default_rng(seed).integers(0, len(shown), min(_SAMPLE, len(shown)))]
    k = min(clusters, len(np.unique(sample, axis=0)))
    model = KMeans(n_clusters=k, n_init=2, random_state=seed)  # type: ignore[arg-type]
    sampled = to_lab(sample)
    model.fit(sampled * _WEIGHT)

    labels = np.empty(len(pixels), np.int16)
    # In blocks, so that a large picture needs little more memory than its own.
    blocks = [slice(start, start + _BLOCK_ROWS) for start in range(0, len(pixels), _BLOCK_ROWS)]
    for block in blocks:
        labels[block] = model.predict(to_lab(pixels[block]) * _WEIGHT)
    labels[blank.ravel()] = -1
    centres = model.cluster_centers_ / _WEIGHT
    naming = name(centres, labels.reshape(rgb.shape[:2]), colours)
    # The clusters from which the colour distance of uncertain pixels counts.
    bluest, water = int(np.argmax(blueness(centres))), np.flatnonzero(naming.kinds == WATER)
    references = water if water.size and bluest not in water else np.array([bluest])
    out = np.zeros(len(pixels), np.float32)
    for block in blocks:
        kind = np.where(labels[block] < 0, COAST, naming.kinds[labels[block]])
        colour = to_lab(pixels[block]) * _WEIGHT
        distance = np.full(len(colour), np.inf, np.float32)
        for centre in model.cluster_centers_[references]:
            distance = np.minimum(distance, np.linalg.norm(colour - centre, axis=-1))
        uncertain = UNCERTAIN_MAX * np.exp(-distance / _DISTANCE_SCALE)
        out[block] = np.where(kind == UNCERTAIN, uncertain, kind == WATER)

    share, tones = shares(labels, k), [to_hex(to_rgb(centre)) for centre in centres]
    kinds = [KINDS[kind] for kind in naming.kinds]
    # How far pixels scatter about their clusters (CIELAB, r.m.s.), and how many lie between the classes: less
    # than twice as far from a cluster of another class as from their own.
    distances, label = np.linalg.norm(sampled[:, None] - centres, axis=-1), np.asarray(model.labels_)
    own, kind_of = distances[np.arange(len(sampled)), label], naming.kinds[label][:, None]
    other = np.where(naming.kinds != kind_of, distances, np.inf).min(axis=1)
    scatter, between = float(np.sqrt(np.mean(own**2))), float((own > 0.5 * other).mean())
    doubts = [doubt.reason for doubt in naming.doubts]
    if between > _BETWEEN_MAX and not colours.complete:
        doubts.append(f"{between:.0%} of the pixels lie between the classes")
    warnings = [
        f"has the colour {tones[n]} ({share[n]:.1%}), which is unlike all that were named: "
        f"it is taken for {kinds[n]}"
        for n in sorted(naming.unlike)
    ]
    apart = scatter <= _SCATTER_BOTH or between <= _BETWEEN_BOTH
    if not apart or scatter > _SCATTER_MAX or between > _BETWEEN_MAX:
        warnings.append(
            "looks more like a photograph than a chart: its colours scatter by "
            f"{scatter:.1f} (CIELAB) about the clusters, {between:.1%} of the pixels lie between the classes"
        )
    found = tuple(Cluster(tones[n], float(share[n]), kinds[n]) for n in np.argsort(-share, kind="stable"))
    passability = out.reshape(rgb.shape[:2])
    return Classified(passability, found, tuple(doubts), naming.notes, tuple(warnings))
