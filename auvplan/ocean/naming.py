"""What the clusters of a chart picture stand for: by colours that a person names, or by rules.

The rules know one style: water is blue, land is not. Styles that break it (white deep water, blue land,
greys, night palettes) cannot all be distinguished by colour, so the proposal says where it is in doubt, and
why.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.ocean.frame import joined
from auvplan.ocean.palette import UNTOLD, ChartColours, blueness, hue_and_chroma, lab_of

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
_FRINGE = (
    0.03  # half the width of water or land, as a share of the picture's edge, up to which it is a fringe
)
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


@dataclass(frozen=True)
class Doubt:
    """Why a proposal may be wrong.

    Attributes:
        reason: in words.
        clusters: the numbers of those that it is about; once they are named by colour it is settled.
    """

    reason: str
    clusters: frozenset[int]


@dataclass(frozen=True)
class Naming:
    """What the clusters stand for.

    Attributes:
        kinds: [k] 0 coast, 1 uncertain, 2 water.
        doubts: why that may be wrong.
        notes: what was assumed, a line each.
        unlike: the clusters that no colour stated is clearly nearest to.
    """

    kinds: NDArray[np.uint8]
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()
    unlike: frozenset[int] = frozenset()


def name_clusters(lab: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return the class of each cluster, from the colour of its centre alone.

    The bluest cluster is water, if it is blue at all, and so are the sea tones that are not far less blue.
    Sea tones (cyan to violet hues) that are much less blue, so pale or greenish, are uncertain. Everything
    else is coast: warm and green hues, and greys too, because nobody may go where a colour says nothing.

    Args:
        lab: cluster centres, [k, 3].

    Returns:
        [k]: 0 coast, 1 uncertain, 2 water.
    """
    sea = _is_sea(lab)
    blue = np.where(sea, blueness(lab), -1.0)
    water = sea & (blue >= max(_BLUE_SHARE * blue.max(), _BLUE_MIN))
    return np.where(water, WATER, np.where(sea, UNCERTAIN, COAST)).astype(np.uint8)


def name(lab: NDArray[np.floating], labels: NDArray[np.integer], colours: ChartColours = UNTOLD) -> Naming:
    """Name clusters by the colours a person gives, and what these leave open by the rules.

    Where water and land are both given, every cluster takes the class of the nearest colour given, in CIELAB,
    and nothing is guessed. Where one of them is missing, only clusters within 15 of a colour take its class:
    a single colour of water would otherwise make everything water. The others keep what the rules propose,
    with those of its doubts that the colours do not settle.

    Args:
        lab: cluster centres, [k, 3].
        labels: [h, w] the cluster of each pixel, negative where there is none.
        colours: given by a person.
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
            doubts.append(Doubt(f"none of its colours is near {' or '.join(given)} of {what}", frozenset()))
    own = distance.min(axis=1)
    other = np.where(classes != classes[nearest][:, None], distance, np.inf).min(axis=1)
    unlike = meant & ((own > _UNLIKE) | (own > _UNCLEAR * other))
    share = np.bincount(labels[labels >= 0], minlength=len(lab)) / max((labels >= 0).sum(), 1)
    return Naming(kinds, tuple(doubts), (*proposed.notes, *notes), _numbers(unlike & (share >= _NOTEWORTHY)))


def _is_sea(lab: NDArray[np.floating]) -> NDArray[np.bool_]:
    hue, chroma = hue_and_chroma(lab)
    return (chroma >= _NEUTRAL_CHROMA) & (hue >= _SEA_HUES[0]) & (hue <= _SEA_HUES[1])


def _propose(lab: NDArray[np.floating], labels: NDArray[np.integer]) -> Naming:
    """Return what the rules make of clusters, and where they are in doubt."""
    step = max(max(labels.shape) // _EDGE, 1)
    labels = labels[::step, ::step]
    share = np.bincount(labels[labels >= 0], minlength=len(lab)) / max((labels >= 0).sum(), 1)
    kinds = name_clusters(lab)
    water = kinds == WATER
    if not water.any():
        return Naming(kinds, (Doubt("none of them looks like water", frozenset()),))
    doubts = [
        *_odd_water(lab, share, water),
        *_odd_land(lab, share, kinds),
        *_odd_shape(lab, share, kinds, labels),
    ]
    pale = _pale_water(lab, share, kinds, labels)
    if isinstance(pale, Doubt):
        doubts.append(pale)
    elif pale is not None:
        said = "the palest tone is taken for deep water, the pale blue along the land for uncertain area"
        return Naming(pale, (*_odd_land(lab, share, pale), *_odd_shape(lab, share, pale, labels)), (said,))
    return Naming(kinds, tuple(doubts))


def _odd_water(lab: NDArray, share: NDArray, water: NDArray[np.bool_]) -> list[Doubt]:
    """Doubts about the colour of the water itself."""
    middle = np.average(lab[water], axis=0, weights=share[water] + 1e-9)
    hue, chroma = (float(value) for value in hue_and_chroma(middle))
    about = _numbers(water)
    if middle[0] < _DARK:
        return [Doubt("the bluest tone is so dark that it may be land as well", about)]
    if chroma < _SURE_CHROMA or not _SURE_HUES[0] <= hue <= _SURE_HUES[1]:
        return [Doubt("no tone is clearly blue", about)]
    return []


def _odd_land(lab: NDArray, share: NDArray, kinds: NDArray[np.uint8]) -> list[Doubt]:
    """Doubts about the colours of what is not water."""
    large = share >= _NOTEWORTHY
    hue, chroma = hue_and_chroma(lab)
    earthy = (hue >= _LAND_HUES[0]) & (hue <= _LAND_HUES[1]) & (chroma <= _LAND_CHROMA)
    odd = (kinds == COAST) & large & ~earthy & (chroma > _FAINT_CHROMA)
    if odd.any():
        return [Doubt("a tone is neither water's nor land's", _numbers(odd))]
    if not (kinds == COAST)[large].any() and _spread_of(lab[large]) > _ONE_TONE:
        return [Doubt("none of them looks like land", _numbers(kinds != COAST))]
    return []


def _odd_shape(
    lab: NDArray, share: NDArray, kinds: NDArray[np.uint8], labels: NDArray[np.integer]
) -> list[Doubt]:
    """Doubts about water that lies in the land as islands do in the sea, or along it as a fringe.

    And about land that is a fringe between waters of two tones, one of which it may surround as a beach does.
    """
    image = np.where(labels >= 0, kinds[labels], COAST)
    water = image == WATER
    about = _numbers(kinds == WATER)
    lakes, islands = _inside(water, labels), _inside(~water, labels)
    if lakes > islands and lakes > _NOTEWORTHY:
        return [Doubt("the blue areas lie within the others as islands do", about)]
    if _narrow(water):
        return [Doubt("the blue areas are narrow as a fringe", about)]
    land = (image == COAST) & (labels >= 0)
    tones = lab[(kinds != COAST) & (share >= max(share[kinds == COAST].sum(), _NOTEWORTHY))]
    if land.mean() >= _NOTEWORTHY and _narrow(land) and _spread_of(tones) > _ONE_TONE:
        return [Doubt("land is narrow as a fringe between two tones of water", _numbers(kinds != COAST))]
    return []


def _narrow(area: NDArray[np.bool_]) -> bool:
    """Return whether an area is nowhere wide."""
    width = np.asarray(scipy.ndimage.distance_transform_edt(area)).max()
    return bool(not area.all() and width < _FRINGE * max(area.shape))


def _spread_of(lab: NDArray) -> float:
    """Return the greatest distance between colours [n, 3]."""
    return float(np.linalg.norm(lab[:, None] - lab, axis=-1).max(initial=0.0))


def _inside(area: NDArray[np.bool_], labels: NDArray[np.integer]) -> float:
    """Return share of a picture in the parts of an area that reach neither its edge nor a line along it."""
    shown = np.pad(labels >= 0, 1)
    reach = max(_RIM * max(labels.shape), 1.0)
    brink = scipy.ndimage.distance_transform_edt(shown)[1:-1, 1:-1] <= reach  # type: ignore[index]
    return float((area & ~brink & ~joined(area & (labels >= 0), brink)).sum() / max(shown.sum(), 1))


def _pale_water(
    lab: NDArray, share: NDArray, kinds: NDArray[np.uint8], labels: NDArray[np.integer]
) -> NDArray[np.uint8] | Doubt | None:
    """Other names for a chart whose shallows are pale blue and whose deep water is paler still, or white.

    That is so where the pale blue lies between the land and the palest tones nearly all along the coast.
    Where it does not, white may be land and blue water, as on maps for the street, or the deep water may
    reach the coast: that is in doubt.

    Returns:
        None where the water is not pale, or there is nothing paler.
    """
    water = kinds == WATER
    _, chroma = hue_and_chroma(lab)
    tone = float(np.average(lab[water, 0], weights=share[water] + 1e-9))
    paper = (lab[:, 0] >= _PAPER[0]) & (chroma < _PAPER[1]) & ~_is_sea(lab)
    paler = paper | (_is_sea(lab) & ~water & (lab[:, 0] > tone))
    if tone < _PALE or share[paler].sum() < _NOTEWORTHY:
        return None
    doubt = Doubt("the palest tone may be deep water as well as land", _numbers(paler))
    # Ink is dark and without hue, and what it mixes with at its edges has small shares.
    land = ~water & ~paler & (share >= _NOTEWORTHY) & ((chroma >= _PAPER[1]) | (lab[:, 0] >= _INK))
    if share[land].sum() < _NOTEWORTHY:
        return doubt
    place = np.where(labels >= 0, labels, 0)
    there = labels >= 0
    ashore, blue, white = (which[place] & there for which in (land, water, paler))
    # The coast's pixels look for the nearest one of either tone: ink may lie between.
    gap, nearest = scipy.ndimage.distance_transform_edt(~(blue | white), return_indices=True)  # type: ignore[misc]
    coast = ashore & (gap <= max(_RING * max(labels.shape) / _EDGE, 2.0))
    sandwiched = blue[tuple(nearest[:, coast])].mean() if coast.any() else 0.0
    away = np.asarray(scipy.ndimage.distance_transform_edt(~ashore))
    distances = np.median(away[white]), np.median(away[blue])
    if (
        not paper[share >= _NOTEWORTHY].any()
        and sandwiched <= 1.0 - _SANDWICHED
        and distances[0] < distances[1]
    ):
        return None  # the paler tone is that of the shallows
    if sandwiched < _SANDWICHED or distances[0] <= 1.5 * distances[1]:
        return doubt
    return np.where(paler, WATER, np.where(water, UNCERTAIN, kinds)).astype(np.uint8)


def _numbers(which: NDArray[np.bool_]) -> frozenset[int]:
    return frozenset(np.flatnonzero(which).tolist())
