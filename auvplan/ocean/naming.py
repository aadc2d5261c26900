"""What the clusters of a chart picture stand for: by colours that a person names, or by rules.

The rules know one style: water is blue, land is not. Styles that break it (white deep water, blue land,
greys, night palettes) cannot all be distinguished by colour, so the proposal says where it is in doubt, and
why.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.ocean.frame import joined
from auvplan.ocean.palette import DEFAULT_COLOURS, ChartColours, blueness, hue_and_chroma, lab_of

COAST, UNCERTAIN, WATER = 0, 1, 2
#: Names of the classes, by their numbers.
KINDS = "coast", "uncertain", "water"

# The rules by which a cluster is named. Hues in degrees: foliage and buff lie below 140, cyan near 200, water
# blue near 270; magenta and red above 310.
_SEA_HUES = (150.0, 310.0)
_NEUTRAL_CHROMA = 5.0  # below this a colour has no hue worth the name: grey, white, black
_BLUE_MIN = 0.05  # a picture whose bluest cluster is no bluer than this shows no open water
_BLUE_SHARE = 0.4  # sea tones with less than this share of the water's blueness are shoals

# What makes a proposal doubtful.
_SURE_HUES, _SURE_CHROMA = (195.0, 305.0), 8.0  # a tone outside these may be anything
_LAND_HUES, _LAND_CHROMA, _FAINT_CHROMA = (40.0, 155.0), 65.0, 20.0  # strong tones of other hues are odd
_ONE_TONE = 25.0  # CIELAB distance up to which all clusters may be water
_RIM = 0.012  # width of a line along the picture's edge, as a share of the edge
_FRINGE = 0.03  # half the width up to which water or land is a fringe, as a share of the edge
_DARK = 35.0  # water darker than this (L) is found in night palettes and satellite pictures
_PALE = 68.0  # water paler than this (L) may be the shallows of a chart whose deep water is white
_PAPER = 88.0, 12.0  # lightest tones: least L, greatest chroma
_INK = 45.0  # greys darker than this (L) are print, not land
_NOTEWORTHY = 0.02  # shares below this are ink and edges
_RING = 6.0  # how far from the sea pixels of land are still coast, pixels of a picture of `_EDGE`
_SANDWICHED = 0.8  # share of the coast along which the pale blue lies between land and the palest tone
_EDGE = 500  # longest edge at which the geometry is looked at, pixels

# CIELAB distance beyond which a colour given is unlike a cluster, and the share of the distance to a colour
# of another class from which on it is not clearly nearer.
_UNLIKE, _UNCLEAR = 25.0, 0.7
_NEAR = 15.0  # CIELAB distance up to which a named colour means a cluster, where not all classes are named


class Concern(NamedTuple):
    """Why a proposal may be wrong, and the clusters that it is about: once these are named it is settled."""

    reason: str
    clusters: frozenset[int] = frozenset()


class Naming(NamedTuple):
    """What the clusters stand for.

    Attributes:
        kinds: [k] 0 coast, 1 uncertain, 2 water.
        doubts: why that may be wrong.
        notes: what was assumed, a line each.
        unlike: the clusters that no colour stated is clearly nearest to.
    """

    kinds: NDArray[np.uint8]
    doubts: tuple[Concern, ...] = ()
    notes: tuple[str, ...] = ()
    unlike: frozenset[int] = frozenset()


class _Clusters:
    """Clusters of a picture [k]: centres in CIELAB, shares of the picture, and the cluster of each pixel."""

    def __init__(self, lab: NDArray[np.floating], labels: NDArray[np.integer]):
        step = max(max(labels.shape) // _EDGE, 1)
        self.lab, self.labels = lab, labels[::step, ::step]
        self.shown, self.share = self.labels >= 0, shares(self.labels, len(lab))
        self.large = self.share >= _NOTEWORTHY
        self.hue, self.chroma = hue_and_chroma(lab)

    def mean(self, which: NDArray[np.bool_]) -> NDArray[np.floating]:
        """Return the mean colour [3] of some clusters."""
        return np.average(self.lab[which], axis=0, weights=self.share[which] + 1e-9)

    def pixels(self, which: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the pixels [h, w] of some clusters."""
        return which[np.where(self.shown, self.labels, 0)] & self.shown


def name_clusters(lab: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return the class of each cluster, from the colour [k, 3] of its centre alone.

    The bluest cluster is water, if it is blue at all, and so are the sea tones that are not far less blue.
    Sea tones (cyan to violet hues) that are much less blue, so pale or greenish, are uncertain. Everything
    else is coast: warm and green hues, and greys too, because nobody may go where a colour says nothing.

    Returns:
        [k]: 0 coast, 1 uncertain, 2 water.
    """
    sea = _is_sea(lab)
    blue = np.where(sea, blueness(lab), -1.0)
    water = sea & (blue >= max(_BLUE_SHARE * blue.max(), _BLUE_MIN))
    return np.where(water, WATER, np.where(sea, UNCERTAIN, COAST)).astype(np.uint8)


def name(
    lab: NDArray[np.floating], labels: NDArray[np.integer], colours: ChartColours = DEFAULT_COLOURS
) -> Naming:
    """Name clusters [k, 3] of pixels [h, w] by the colours given, and what these leave open by the rules.

    Where water and land are both given, every cluster takes the class of the nearest colour given, in CIELAB,
    and nothing is guessed. Where one of them is missing, only clusters within 15 of a colour take its class:
    a single colour of water would otherwise make everything water. The others keep what the rules propose,
    with those of its doubts that the colours do not settle.
    """
    if not colours:
        return _propose(lab, labels)
    stated, classes = colours.listed()
    distance = np.linalg.norm(lab[:, None] - lab_of(stated), axis=-1)
    nearest = distance.argmin(axis=1)
    meant = np.ones(len(lab), bool) if colours.complete else distance.min(axis=1) <= _NEAR
    unused = [colour for k, colour in enumerate(stated) if not (nearest[meant] == k).any()]
    notes = tuple(f"no cluster is near the colour {colour}" for colour in unused)
    proposed = Naming(np.zeros(len(lab), np.uint8)) if colours.complete else _propose(lab, labels)
    # Rules that see no water have nothing to measure uncertain area by.
    rest = proposed.kinds if (proposed.kinds == WATER).any() else np.full(len(lab), COAST, np.uint8)
    kinds = np.where(meant, classes[nearest], rest).astype(np.uint8)
    settled = frozenset(np.flatnonzero(meant).tolist())
    doubts = [doubt for doubt in proposed.doubts if not (doubt.clusters and doubt.clusters <= settled)]
    if (kinds == WATER).any():
        doubts = [doubt for doubt in doubts if doubt.clusters]
    for kind, given, what in ((WATER, colours.water, "water"), (COAST, colours.land, "land")):
        if given and not (kinds[meant] == kind).any():
            doubts.append(Concern(f"none of its colours is near {' or '.join(given)} of {what}"))
    own = distance.min(axis=1)
    other = np.where(classes != classes[nearest][:, None], distance, np.inf).min(axis=1)
    unlike = meant & ((own > _UNLIKE) | (own > _UNCLEAR * other))
    unlike &= shares(labels, len(lab)) >= _NOTEWORTHY
    return Naming(kinds, tuple(doubts), (*proposed.notes, *notes), _numbers(unlike))


def shares(labels: NDArray[np.integer], count: int) -> NDArray[np.floating]:
    """Return the share of each of `count` clusters in the pixels that have one, [k]."""
    shown = labels[labels >= 0]
    return np.bincount(shown, minlength=count) / max(shown.size, 1)


def _is_sea(lab: NDArray[np.floating]) -> NDArray[np.bool_]:
    hue, chroma = hue_and_chroma(lab)
    return (chroma >= _NEUTRAL_CHROMA) & (hue >= _SEA_HUES[0]) & (hue <= _SEA_HUES[1])


def _propose(lab: NDArray[np.floating], labels: NDArray[np.integer]) -> Naming:
    """Return what the rules make of clusters, and where they are in doubt."""
    kinds, clusters = name_clusters(lab), _Clusters(lab, labels)
    if not (kinds == WATER).any():
        return Naming(kinds, (Concern("none of them looks like water"),))
    pale, notes = _pale_water(clusters, kinds), ()
    if isinstance(pale, np.ndarray):
        kinds, found = pale, [_odd_land(clusters, pale), _odd_shape(clusters, pale)]
        note = "the palest tone is taken for deep water, the pale blue along the land for uncertain area"
        notes = (note,)
    else:
        found = [*(rule(clusters, kinds) for rule in (_odd_water, _odd_land, _odd_shape)), pale]
    return Naming(kinds, tuple(doubt for doubt in found if doubt), notes)


def _odd_water(clusters: _Clusters, kinds: NDArray[np.uint8]) -> Concern | None:
    """Return a concern about the colour of the water itself."""
    middle, about = clusters.mean(kinds == WATER), _numbers(kinds == WATER)
    hue, chroma = (float(value) for value in hue_and_chroma(middle))
    if middle[0] < _DARK:
        return Concern("the bluest tone is so dark that it may be land as well", about)
    if chroma < _SURE_CHROMA or not _SURE_HUES[0] <= hue <= _SURE_HUES[1]:
        return Concern("no tone is clearly blue", about)
    return None


def _odd_land(clusters: _Clusters, kinds: NDArray[np.uint8]) -> Concern | None:
    """Return a concern about the colours of what is not water."""
    hue, chroma, large = clusters.hue, clusters.chroma, clusters.large
    earthy = (hue >= _LAND_HUES[0]) & (hue <= _LAND_HUES[1]) & (chroma <= _LAND_CHROMA)
    odd = (kinds == COAST) & large & ~earthy & (chroma > _FAINT_CHROMA)
    if odd.any():
        return Concern("a tone is neither water's nor land's", _numbers(odd))
    if not (kinds == COAST)[large].any() and _spread_of(clusters.lab[large]) > _ONE_TONE:
        return Concern("none of them looks like land", _numbers(kinds != COAST))
    return None


def _odd_shape(clusters: _Clusters, kinds: NDArray[np.uint8]) -> Concern | None:
    """Return a concern about water that lies in the land as islands do in the sea, or along it as a fringe.

    Or about land that is a fringe between waters of two tones, one of which it may surround as a beach does.
    """
    water, land = clusters.pixels(kinds == WATER), clusters.pixels(kinds == COAST)
    lakes, islands = _inside(water, clusters.shown), _inside(~water, clusters.shown)
    if lakes > islands and lakes > _NOTEWORTHY:
        return Concern("the blue areas lie within the others as islands do", _numbers(kinds == WATER))
    if _narrow(water):
        return Concern("the blue areas are narrow as a fringe", _numbers(kinds == WATER))
    most = max(clusters.share[kinds == COAST].sum(), _NOTEWORTHY)
    tones = clusters.lab[(kinds != COAST) & (clusters.share >= most)]
    if land.mean() >= _NOTEWORTHY and _narrow(land) and _spread_of(tones) > _ONE_TONE:
        return Concern("land is narrow as a fringe between two tones of water", _numbers(kinds != COAST))
    return None


def _narrow(area: NDArray[np.bool_]) -> bool:
    """Return whether an area is nowhere wide."""
    width = np.asarray(scipy.ndimage.distance_transform_edt(area)).max()
    return bool(not area.all() and width < _FRINGE * max(area.shape))


def _spread_of(lab: NDArray) -> float:
    """Return the greatest distance between colours [n, 3]."""
    return float(np.linalg.norm(lab[:, None] - lab, axis=-1).max(initial=0.0))


def _inside(area: NDArray[np.bool_], shown: NDArray[np.bool_]) -> float:
    """Return share of a picture in the parts of an area that reach neither its edge nor a line along it."""
    reach = max(_RIM * max(shown.shape), 1.0)
    edge = scipy.ndimage.distance_transform_edt(np.pad(shown, 1))
    brink = edge[1:-1, 1:-1] <= reach  # type: ignore[index]
    return float((area & ~brink & ~joined(area & shown, brink)).sum() / max(shown.sum(), 1))


def _pale_water(clusters: _Clusters, kinds: NDArray[np.uint8]) -> NDArray[np.uint8] | Concern | None:
    """Other names for a chart whose shallows are pale blue and whose deep water is paler still, or white.

    That is so where the pale blue lies between the land and the palest tones nearly all along the coast.
    Where it does not, white may be land and blue water, as on maps for the street, or the deep water may
    reach the coast: that is in doubt.

    Returns:
        None where the water is not pale, or there is nothing paler.
    """
    water, light, share = kinds == WATER, clusters.lab[:, 0], clusters.share
    tone = float(clusters.mean(water)[0])
    paper = (light >= _PAPER[0]) & (clusters.chroma < _PAPER[1]) & ~_is_sea(clusters.lab)
    paler = paper | (_is_sea(clusters.lab) & ~water & (light > tone))
    if tone < _PALE or share[paler].sum() < _NOTEWORTHY:
        return None
    concern = Concern("the palest tone may be deep water as well as land", _numbers(paler))
    # Ink is dark and without hue, and what it mixes with at its edges has small shares.
    land = ~water & ~paler & clusters.large & ((clusters.chroma >= _PAPER[1]) | (light >= _INK))
    if share[land].sum() < _NOTEWORTHY:
        return concern
    ashore, blue, white = (clusters.pixels(which) for which in (land, water, paler))
    # The coast's pixels look for the nearest one of either tone: ink may lie between.
    gap, nearest = scipy.ndimage.distance_transform_edt(~(blue | white), return_indices=True)  # type: ignore[misc]
    coast = ashore & (gap <= max(_RING * max(ashore.shape) / _EDGE, 2.0))
    sandwiched = blue[tuple(nearest[:, coast])].mean() if coast.any() else 0.0
    away = np.asarray(scipy.ndimage.distance_transform_edt(~ashore))
    deep, shallow = np.median(away[white]), np.median(away[blue])
    if not paper[clusters.large].any() and sandwiched <= 1.0 - _SANDWICHED and deep < shallow:
        return None  # the paler tone is that of the shallows
    if sandwiched < _SANDWICHED or deep <= 1.5 * shallow:
        return concern
    return np.where(paler, WATER, np.where(water, UNCERTAIN, kinds)).astype(np.uint8)


def _numbers(which: NDArray[np.bool_]) -> frozenset[int]:
    return frozenset(np.flatnonzero(which).tolist())
