"""Chart pictures of other styles than the shipped one, with their true classes."""

import functools
import io
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from auvplan.ocean.whitsunday import classes

Colour = tuple[int, int, int]

#: Pixels along each edge.
SIZE = 400


@dataclass(frozen=True)
class Style:
    """A way to paint a chart.

    Attributes:
        land, uncertain, water: colours.
        grain: standard deviation of the noise of each pixel, levels.
        relief: the same of smooth shading, over some 10 pixels.
        texture: relative strength of a texture of some pixels, different on land and water.
        lines: whether contours, soundings and a wreck are printed over it.
        jpeg: quality it is stored in, or None.
    """

    land: Colour
    uncertain: Colour
    water: Colour
    grain: float = 0.0
    relief: float = 0.0
    texture: float = 0.0
    lines: bool = False
    jpeg: int | None = None

    @property
    def named(self) -> dict[str, tuple[str, ...]]:
        """The colours by what they stand for."""
        stated = {"water": self.water, "land": self.land, "uncertain": self.uncertain}
        return {kind: ("#{:02x}{:02x}{:02x}".format(*colour),) for kind, colour in stated.items()}


STYLES = {
    "white deep water": Style((246, 224, 154), (189, 219, 240), (255, 255, 255), lines=True),
    "grey": Style((128, 128, 128), (182, 182, 182), (232, 232, 232), grain=3.0),
    "satellite": Style((74, 78, 46), (58, 132, 128), (14, 40, 66), 7.0, 5.0, 0.22, jpeg=85),
    "dark": Style((66, 66, 70), (40, 84, 92), (17, 24, 38), grain=2.0, lines=True),
    "inverted": Style((41, 59, 109), (105, 41, 51), (185, 125, 55), grain=3.0, relief=3.0),
    "blue land": Style((96, 140, 205), (214, 180, 140), (244, 232, 190), grain=3.0),
}


@functools.cache
def paint(style: Style, size: int = SIZE, seed: int = 0) -> np.ndarray:
    """A picture of the shipped waters in a style, [size, size, 3] uint8, row 0 in the north, read-only."""
    picture = _paint(classes(size), style, seed)
    picture.setflags(write=False)
    return picture


def _paint(kinds: np.ndarray, style: Style, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    size = kinds.shape[0]
    clean = np.asarray([style.land, style.uncertain, style.water], float)[kinds]

    def field(width: float) -> np.ndarray:
        smooth = ndimage.gaussian_filter(rng.normal(size=kinds.shape), width)
        return smooth / smooth.std()

    waves = np.where(kinds == 0, field(3.0), 0.5 * field(1.2))
    picture = clean * (1.0 + style.texture * waves)[..., None]
    picture += style.relief * field(10.0)[..., None]
    picture += style.grain * rng.normal(size=picture.shape)
    image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    if style.lines:
        ink = (20, 20, 20) if min(style.water) > 127 else (150, 150, 150)
        picture = np.array(image)
        picture[(kinds == 1) & ndimage.binary_dilation(kinds == 2)] = ink
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        for _ in range(60):
            row, column = rng.integers(10, size - 20, 2)
            if kinds[row, column] == 2:
                draw.text((column, row), str(rng.integers(10, 90)), fill=ink)
    if style.jpeg is not None:
        stored = io.BytesIO()
        image.save(stored, "JPEG", quality=style.jpeg)
        image = Image.open(stored)
    return np.asarray(image.convert("RGB"))


def shares_right(passability: np.ndarray, kinds: np.ndarray) -> dict[str, float]:
    """Shares of the true land and of the true water that a passability raster has right."""
    return {
        "land": float((passability[kinds == 0] == 0.0).mean()),
        "water": float((passability[kinds == 2] == 1.0).mean()),
    }


def landscape(size: int, slope: float, rng: np.random.Generator) -> np.ndarray:
    """[n, n] of a random surface whose spectrum falls with a power of the wave number."""
    frequency = np.fft.fftfreq(size)
    number = np.hypot(*np.meshgrid(frequency, frequency))
    number[0, 0] = 1.0
    surface = np.fft.ifft2(np.fft.fft2(rng.normal(size=(size, size))) * number ** (-slope / 2.0)).real
    return (surface - surface.mean()) / surface.std()


def satellite(texture: float, seed: int, size: int = 400) -> np.ndarray:
    """[n, n, 3] of islands as from space: woods and rock, clear shallows, the noise of a sensor."""
    rng = np.random.default_rng(seed)
    height = landscape(size, 3.2, rng) - 0.5
    shallow = np.exp(np.minimum(height, 0.0) / 0.25)[..., None]
    water = np.array([14.0, 38.0, 66.0]) + shallow * [25.0, 75.0, 60.0]
    water += texture * 2.5 * landscape(size, 1.0, rng)[..., None]
    bare = 1.0 / (1.0 + np.exp(-1.5 * landscape(size, 2.2, rng)))[..., None]
    ground = (1.0 - bare) * [52.0, 72.0, 38.0] + bare * [142.0, 122.0, 92.0]
    ground += texture * 18.0 * landscape(size, 1.6, rng)[..., None]
    noise = 3.0 * rng.normal(size=(size, size, 1)) + 1.5 * rng.normal(size=(size, size, 3))
    return np.clip(np.where(height[..., None] > 0.0, ground, water) + noise, 0.0, 255.0).astype(np.uint8)
