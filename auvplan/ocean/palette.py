"""Colours: as people write them, as the eye distinguishes them, and what they stand for on a chart."""

import difflib
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

# sRGB (D65) to XYZ, rows already divided by the white point (IEC 61966-2-1).
_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
) / np.array([[0.95047], [1.0], [1.08883]])

# Linear light of each of the 256 sRGB levels.
_LEVEL = np.arange(256) / 255.0
_LINEAR = np.where(_LEVEL <= 0.04045, _LEVEL / 12.92, ((_LEVEL + 0.055) / 1.055) ** 2.4).astype(np.float32)


@dataclass(frozen=True)
class ChartColours:
    """Colours of a picture by what they stand for: CSS names or #rrggbb, kept as #rrggbb.

    Attributes:
        water: of water.
        land: of land.
        uncertain: of uncertain area.

    Raises:
        ValueError: one line; what is given is no colour, or stands for two things.
    """

    water: tuple[str, ...] = ()
    land: tuple[str, ...] = ()
    uncertain: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        taken: dict[str, str] = {}
        for field in fields(self):
            found = tuple(dict.fromkeys(as_hex(colour) for colour in getattr(self, field.name)))
            object.__setattr__(self, field.name, found)
            for colour in found:
                if taken.setdefault(colour, field.name) != field.name:
                    raise ValueError(f"{colour} is given for {taken[colour]} and for {field.name}")

    def __bool__(self) -> bool:
        return bool(self.water or self.land or self.uncertain)

    @property
    def complete(self) -> bool:
        """Whether nothing is left to be guessed."""
        return bool(self.water and self.land)

    def listed(self) -> tuple[tuple[str, ...], NDArray[np.uint8]]:
        """Return all colours, and the class of each: 0 coast, 1 uncertain, 2 water."""
        groups = self.land, self.uncertain, self.water
        kinds = [np.full(len(group), kind, np.uint8) for kind, group in enumerate(groups)]
        return tuple(colour for group in groups for colour in group), np.concatenate(kinds)


#: No colour is given.
DEFAULT_COLOURS = ChartColours()


def as_hex(colour: str) -> str:
    """Return a colour that Pillow knows, such as a CSS name, #rgb or hsl(...), as #rrggbb.

    Raises:
        ValueError: it is none.
    """
    try:
        red, green, blue = ImageColor.getrgb(colour.strip())[:3]
    except ValueError:
        near = difflib.get_close_matches(colour.lower(), ImageColor.colormap, 1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(
            f"{colour!r} is no colour: give a CSS name such as lightblue, or '#rrggbb'{meant}"
        ) from None
    return to_hex(np.array([red, green, blue]))


def to_hex(rgb: NDArray) -> str:
    """Return an RGB colour, [3] in 0..255, as #rrggbb."""
    red, green, blue = np.clip(np.rint(rgb), 0, 255).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def lab_of(colours: tuple[str, ...]) -> NDArray[np.float32]:
    """CIELAB of colours by name, [n, 3]."""
    return to_lab(np.array([ImageColor.getrgb(colour)[:3] for colour in colours], np.uint8).reshape(-1, 3))


def to_lab(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """CIELAB (D65) of sRGB colours [..., 3].

    Returns:
        ``(L, a, b)`` on the last axis, [..., 3]; L in 0..100, b negative towards blue.
    """
    xyz = _LINEAR[rgb] @ _XYZ.T.astype(np.float32)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + np.float32(16.0 / 116.0))
    return np.stack(
        [116.0 * f[..., 1] - 16.0, 500.0 * (f[..., 0] - f[..., 1]), 200.0 * (f[..., 1] - f[..., 2])], axis=-1
    ).astype(np.float32)


def to_rgb(lab: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return the nearest sRGB colours of CIELAB (D65) ones, [..., 3]: the inverse of `to_lab`."""
    y = (lab[..., 0] + 16.0) / 116.0
    f = np.stack([y + lab[..., 1] / 500.0, y, y - lab[..., 2] / 200.0], axis=-1)
    xyz = np.where(f**3 > 0.008856, f**3, (f - 16.0 / 116.0) / 7.787)
    linear = np.clip(xyz @ np.linalg.inv(_XYZ).T, 0.0, 1.0)
    level = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * level).astype(np.uint8)


def hue_and_chroma(lab: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Hue, degrees in [0, 360), and chroma of CIELAB colours [..., 3]."""
    return np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360.0, np.hypot(lab[..., 1], lab[..., 2])


def blueness(lab: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return how blue a CIELAB colour [..., 3] is, in [-1, 1]: ``-b / |(L, a, b)|``.

    0 for greys, dark blue as much as bright.

    Returns:
        [...].
    """
    # The 5 keeps near-black, whose hue is noise, near 0.
    return -lab[..., 2] / (np.linalg.norm(lab, axis=-1) + 5.0)
