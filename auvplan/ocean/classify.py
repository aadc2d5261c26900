"""From the colours of a chart picture to passability, by k-means (section 2 of the paper).

The paper clusters a map picture into coast, uncertain area and water. k-means returns its clusters in no
particular order, and how many tones a class has differs from picture to picture. So the picture is cut into
more clusters than there are classes, and each cluster is named by the colour of its own centre: hue and
blueness, both taken in CIELAB, where distance and hue follow what the eye sees.
"""

import hashlib
from functools import partial
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.cache import kept

UNCERTAIN_MAX = 0.35
"""Highest passability of an uncertain pixel (section 2 of the paper)."""

DEFAULT_CLUSTERS = 8
"""More than the three classes: shaded relief and depth tints give land and water several tones each, and with
three clusters k-means would rather halve a large class than single out a small one."""

# The rules by which a cluster is named. Hues in degrees: foliage and buff lie below 140, cyan near 200, water
# blue near 270; magenta and red above 310.
_SEA_HUES = (150.0, 310.0)
_NEUTRAL_CHROMA = 5.0  # below this a colour has no hue worth the name: grey, white, black
_BLUE_MIN = 0.05  # a picture whose bluest cluster is no bluer than this shows no open water
_BLUE_SHARE = 0.4  # sea tones with less than this share of the water's blueness are shoals

_LIGHTNESS_WEIGHT = 0.5  # shading varies lightness within a class; hue is what tells the classes apart
_DISTANCE_SCALE = 50.0  # colour distance over which an uncertain pixel's passability falls by 1/e
_SAMPLE = 30_000
_BLOCK_ROWS = 1_000_000

# sRGB (D65) to XYZ, rows already divided by the white point (IEC 61966-2-1).
_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
) / np.array([[0.95047], [1.0], [1.08883]])


def _linear_table() -> NDArray[np.float32]:
    """Linear light of each of the 256 sRGB levels, [256]."""
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def to_lab(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """CIELAB (D65) of sRGB colours.

    Args:
        rgb: [..., 3] uint8.

    Returns:
        ``(L, a, b)`` on the last axis, [..., 3]; L in 0..100, b negative towards blue.
    """
    xyz = _linear_table()[rgb] @ _XYZ.T.astype(np.float32)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + np.float32(16.0 / 116.0))
    return np.stack(
        [116.0 * f[..., 1] - 16.0, 500.0 * (f[..., 0] - f[..., 1]), 200.0 * (f[..., 1] - f[..., 2])], axis=-1
    ).astype(np.float32)


def blueness(lab: NDArray[np.floating]) -> NDArray[np.floating]:
    """How blue a colour is, in [-1, 1]: ``-b / |(L, a, b)|``; 0 for greys, dark blue as much as bright.

    Args:
        lab: CIELAB colours, [..., 3].

    Returns:
        [...].
    """
    # The 5 keeps near-black, whose hue is noise, near 0.
    return -lab[..., 2] / (np.linalg.norm(lab, axis=-1) + 5.0)


def name_clusters(lab: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The class of each cluster, from the colour of its centre alone.

    The bluest cluster is water, if it is blue at all, and so are the sea tones that are not far less blue.
    Sea tones (cyan to violet hues) that are much less blue, so pale or greenish, are uncertain. Everything
    else is coast: warm and green hues, and greys too, because a colour that says nothing must not be sailed
    over.

    Args:
        lab: cluster centres, [k, 3].

    Returns:
        [k]: 0 coast, 1 uncertain, 2 water.
    """
    hue = np.degrees(np.arctan2(lab[:, 2], lab[:, 1])) % 360.0
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    sea = (chroma >= _NEUTRAL_CHROMA) & (hue >= _SEA_HUES[0]) & (hue <= _SEA_HUES[1])
    blue = np.where(sea, blueness(lab), -1.0)
    water = sea & (blue >= max(_BLUE_SHARE * blue.max(), _BLUE_MIN))
    return np.where(water, 2, np.where(sea, 1, 0)).astype(np.uint8)


def classify(rgb: NDArray[np.uint8], clusters: int = DEFAULT_CLUSTERS, seed: int = 0) -> NDArray[np.float32]:
    """Passability of every pixel of a chart picture.

    A 3 x 3 median takes out single-pixel noise, k-means is fitted on a random subset of the pixels, every
    pixel goes to its nearest cluster, and clusters are named by `name_clusters`. The passability of an
    uncertain pixel is ``0.35 exp(-d / 50)`` with d its colour distance from the centre of the bluest cluster.

    Args:
        rgb: the picture, [h, w, 3] uint8.
        clusters: number of clusters; fewer are used where the picture has fewer colours.
        seed: seed of the subset and of k-means.

    Returns:
        [h, w] float32, in the picture's own orientation: 0 coast, (0, 0.35] uncertain, 1 water.

    Raises:
        ValueError: `rgb` is not such an array, it is empty, or `clusters` is not positive.

    Differences from the paper:
        It names neither the number of clusters nor how the value of an uncertain pixel follows from its
        colour; both are chosen here. Its blue clusters are water; here sea tones far less blue are uncertain.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or rgb.size == 0:
        raise ValueError(f"a picture is a non-empty [h, w, 3] uint8 array, got {rgb.dtype} {list(rgb.shape)}")
    if clusters < 1:
        raise ValueError(f"clusters must be positive, got {clusters}")
    parts = hashlib.sha256(rgb.tobytes()).hexdigest(), f"{rgb.shape} {clusters} {seed}"
    return kept(
        "auvplan.ocean.classify", partial(_classified, rgb, clusters, seed), *parts, version("scikit-learn")
    )


def _classified(rgb: NDArray[np.uint8], clusters: int, seed: int) -> NDArray[np.float32]:
    """`classify` of what is a picture."""
    # Imported here because it takes most of a second, and only pictures need it.
    from sklearn.cluster import KMeans

    smooth = np.stack([ndimage.median_filter(rgb[..., c], size=3, mode="nearest") for c in range(3)], axis=-1)
    pixels = smooth.reshape(-1, 3)
    sample = pixels[np.random.default_rng(seed).integers(0, len(pixels), min(_SAMPLE, len(pixels)))]
    k = min(clusters, len(np.unique(sample, axis=0)))
    weight = np.array([_LIGHTNESS_WEIGHT, 1.0, 1.0], np.float32)
    model = KMeans(n_clusters=k, n_init=2, random_state=seed)  # type: ignore[arg-type]
    model.fit(to_lab(sample) * weight)

    centers = model.cluster_centers_ / weight
    names = name_clusters(centers)
    bluest = model.cluster_centers_[np.argmax(blueness(centers))]
    out = np.empty(len(pixels), np.float32)
    # In blocks, so that a large picture needs little more memory than its own.
    for start in range(0, len(pixels), _BLOCK_ROWS):
        colour = to_lab(pixels[start : start + _BLOCK_ROWS]) * weight
        name = names[model.predict(colour)]
        distance = np.linalg.norm(colour - bluest, axis=-1)
        uncertain = UNCERTAIN_MAX * np.exp(-distance / _DISTANCE_SCALE)
        out[start : start + _BLOCK_ROWS] = np.where(name == 1, uncertain, name == 2)
    return out.reshape(rgb.shape[:2])
