"""Sea beds and charts of ``benchmarks.files``: as read, and as rasterio, netCDF4 and shapely do."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import rasterio
import shapely
import xarray as xr
from pyproj import Proj, Transformer
from rasterio.features import rasterize
from rasterio.transform import Affine, from_bounds
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from auvplan.io.geo import chart_from_polygons, chart_from_raster, read_bathymetry, read_raster
from auvplan.io.geo.grid import Extent
from auvplan.site import Site
from benchmarks.file_models import Prepared, copied, save
from benchmarks.file_references import LENGTHS, Raw
from benchmarks.harness import SHARED

#: Passability of the classes of the pictures' truth: land, reef, water.
CLASSES = {0: 0.0, 1: 0.3, 2: 1.0}


@dataclass(frozen=True)
class Box:
    """A rectangle about a site, m: half its sides north and east, and the edge of its pixels."""

    site: Site
    half: tuple[float, float]
    pixel: float

    @property
    def extent(self) -> Extent:
        north, east = self.half
        return Extent((-north, -east), (north, east), self.pixel)

    @property
    def local(self) -> Proj:
        """Degrees to m east and north of the site."""
        return Proj(proj="aeqd", lon_0=self.site.longitude, lat_0=self.site.latitude, datum="WGS84")

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Longitude and latitude [nx, ny] of the pixels' centres, by PROJ."""
        counts = [int(np.ceil(2 * side / self.pixel - 1e-6)) for side in self.half]
        axes = [-side + (np.arange(n) + 0.5) * self.pixel for side, n in zip(self.half, counts, strict=True)]
        north, east = np.meshgrid(*axes, indexing="ij")
        return self.local(east, north, inverse=True)


@dataclass(frozen=True)
class Rasters:
    name: str  # what it is; kind is "sea bed", "chart" or "picture"
    kind: str
    origin: str
    prepare: Callable[[Path], Prepared]  # a folder to the file there
    read: Callable[[Path], np.ndarray]  # what auvplan makes of it, [n, m] or [n, m, 3]
    expect: Callable[[Path], np.ndarray]  # what other libraries find there
    exact: float = 1e-3  # largest difference, in the values' unit, that is none
    variables: tuple[str, ...] = ()  # of NetCDF that mutations look at, as of `Currents`

    def equal(self, found: np.ndarray, expected: np.ndarray) -> float:
        """Share of the pixels that are the same."""
        missing = np.isnan(found) & np.isnan(expected)
        return float(((np.abs(found - expected) <= self.exact) | missing).mean())


def bilinear(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Between nodes, held beyond the outer ones; NaN beside NaN."""
    missing = np.isnan(values)
    held = [np.clip(at, 0, size - 1) for at, size in zip((row, column), values.shape, strict=True)]
    found = map_coordinates(np.where(missing, 0.0, values), held, order=1, mode="nearest")
    return np.where(
        map_coordinates(missing.astype(float), held, order=1, mode="nearest") > 1e-9, np.nan, found
    )


def _tiff(path: Path, box: Box) -> tuple[np.ma.MaskedArray, np.ndarray, np.ndarray]:
    """First band of a GeoTIFF in its unit, by rasterio, and rows and columns of the box's pixels there."""
    with rasterio.open(path) as source:
        x, y = Transformer.from_crs(4326, source.crs, always_xy=True).transform(*box.centres())
        column, row = ~source.transform * (np.asarray(x), np.asarray(y))
        return source.read(1, masked=True).astype(float) * source.scales[0] + source.offsets[0], row, column


def tiff_depth(path: Path, box: Box) -> np.ndarray:
    """Depth, m, of heights in a GeoTIFF."""
    values, row, column = _tiff(path, box)
    values = values.filled(np.nan)
    return -bilinear(np.where(np.abs(values) > 12_000.0, np.nan, values), row - 0.5, column - 0.5)


def _height(raw: Raw, name: str, dims: Sequence[str] | None) -> np.ndarray:
    """Values in m; what no sea floor has is missing."""
    values = raw.values(name, dims) * raw.factor(name, LENGTHS)
    return np.where((np.abs(values) > 12_000.0) | (np.abs(values) == 9999.0), np.nan, values)


def axes_depth(path: Path, names: Sequence[str], box: Box, sign: float) -> np.ndarray:
    """Depth, m, of a variable on two axes, by netCDF4; names: variable, longitude, latitude."""
    with Raw(path) as raw:
        lon, lat = (raw.values(name) for name in names[1:])
        dims = *raw.variable(names[2]).dimensions, *raw.variable(names[1]).dimensions
        z = _height(raw, names[0], dims)
    lon, rows = np.unwrap(lon, period=360.0), np.arange(len(lat))
    if lon[0] > lon[-1]:
        lon, z = lon[::-1], z[:, ::-1]
    longitude, latitude = box.centres()
    row = np.interp(latitude, *((lat, rows) if lat[0] < lat[-1] else (lat[::-1], rows[::-1])))
    near = lon.min() + (longitude - lon.min()) % 360.0
    return sign * bilinear(z, row, np.interp(near, lon, np.arange(len(lon))))


def grid_depth(path: Path, names: Sequence[str], box: Box, mask: str | None = None) -> np.ndarray:
    """Depth, m, of a variable on a grid of places, by netCDF4: bilinear in rows and columns."""
    with Raw(path) as raw:
        dims = raw.variable(names[1]).dimensions
        lon, lat, z = raw.values(names[1]), raw.values(names[2], dims), _height(raw, names[0], dims)
        if mask is not None and raw.find(mask) is not None:
            z = np.where(raw.values(mask, dims) == 0, np.nan, z)
    local = box.local
    if not np.isfinite(lon + lat).all():
        raise ValueError("places are missing")
    x, y = local(lon, lat)
    goal = np.stack(local(*box.centres()))
    nodes = np.stack([x.ravel(), y.ravel()], axis=1)
    _, near = KDTree(nodes).query(goal.reshape(2, -1).T)
    at = np.stack(np.unravel_index(near, x.shape)).reshape(2, *goal.shape[1:]).astype(float)

    def place(at: np.ndarray) -> np.ndarray:
        return np.stack([map_coordinates(axis, at, order=1, mode="nearest") for axis in (x, y)])

    for _ in range(30):  # Newton's way into the cell
        off = goal - place(at)
        slopes = []
        for k in range(2):
            step = np.zeros_like(at)
            step[k] = 1e-3
            slopes.append((place(at + step) - place(at - step)) / 2e-3)
        (a, c), (b, d) = slopes
        area = a * d - b * c
        at[0] = np.clip(at[0] + (d * off[0] - b * off[1]) / area, 0, x.shape[0] - 1)
        at[1] = np.clip(at[1] + (a * off[1] - c * off[0]) / area, 0, x.shape[1] - 1)
    return bilinear(z, *at)


def tiff_classes(path: Path, box: Box) -> np.ndarray:
    """Passability of the nearest pixel of a raster of classes."""
    values, *at = _tiff(path, box)
    i, j = (np.clip(np.floor(a).astype(int), 0, n - 1) for a, n in zip(at, values.shape, strict=True))
    return np.vectorize(CLASSES.get)(values.data[i, j])


def pixels(path: Path) -> np.ndarray:
    """[rows, columns, bands] of a picture, by rasterio."""
    with rasterio.open(path) as source:
        return np.moveaxis(source.read(), 0, -1)[..., :3]


def picture(path: Path, crs: int | None = None) -> np.ndarray:
    """[rows, columns, 3] of a picture, as auvplan reads it."""
    return read_raster(path, crs).transpose("y", "x", "band").values


def classes(path: Path, box: Box) -> np.ndarray:
    return np.asarray(chart_from_raster(path, box.site, box.extent, classes=CLASSES).passability)


def land(path: Path, box: Box) -> np.ndarray:
    """0 for land, 1 for water, as auvplan reads it."""
    return np.asarray(chart_from_polygons(path, box.site, box.extent).passability)


def rasterized(path: Path, box: Box) -> np.ndarray:
    """0 for every pixel that land touches, by GDAL's rasterizer on polygons in local metres."""
    if path.suffix == ".geojson":
        features = json.loads(path.read_text())["features"]
        shapes = shapely.from_geojson([json.dumps(feature["geometry"]) for feature in features])
    else:
        meta, _, wkb, _ = pyogrio.raw.read(path)
        turn = Transformer.from_crs(meta["crs"], 4326, always_xy=True)
        shapes = shapely.transform(shapely.from_wkb(wkb), lambda p: np.stack(turn.transform(*p.T), axis=1))
    local = box.local
    x, y = box.site.longitude, box.site.latitude
    near = shapely.box(x - 3, y - 3, x + 3, y + 3)
    shapes = [shape for shape in shapes if shape.intersects(near)]
    shapes = shapely.segmentize(np.asarray(shapes, object), 0.01)  # edges are straight in degrees
    shapes = shapely.transform(shapes, lambda p: np.stack(local(*p.T), axis=1))
    north, east = (int(np.ceil(2 * side / box.pixel - 1e-6)) for side in box.half)
    where = from_bounds(-box.half[1], -box.half[0], -box.half[1] + east * box.pixel,
                        -box.half[0] + north * box.pixel, east, north)  # fmt: skip
    burnt = rasterize(
        [(s, 1) for s in shapes], (north, east), transform=where, all_touched=True, dtype="uint8"
    )
    return np.where(burnt[::-1] == 1, 0.0, 1.0)


def _utm_floor(folder: Path) -> Prepared:
    """A GeoTIFF of heights in UTM, packed in decimetres, with missing pixels."""
    rows, columns = np.meshgrid(np.arange(60), np.arange(80), indexing="ij")
    values = (-300 - 4 * rows - 7 * columns + (rows * columns) % 11).astype(np.int16)
    values[5:9, 60:70] = -32768
    path = folder / "utm_packed.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=80, height=60, count=1, dtype="int16", crs="EPSG:32632",
        transform=Affine(100.0, 0.0, 300_000.0, 0.0, -100.0, 6_656_000.0), nodata=-32768, compress="deflate",
    ) as sink:  # fmt: skip
        sink.write(values, 1)
        sink.scales, sink.offsets = (0.1,), (0.0,)
        sink.units = ("metre",)
    return [path], {}


def _gebco(folder: Path) -> Prepared:
    lon, lat = 359.5 + np.arange(300) / 240.0, 50.0 + np.arange(200) / 240.0
    values = np.rint(-60 + 30 * np.sin(lon * 9)[None] * np.cos(lat * 7)[:, None]).astype(np.int16)
    fields = {
        "elevation": (("lat", "lon"), values, {"units": "m", "standard_name": "height_above_mean_sea_level"}),
        "lon": (("lon",), lon, {"units": "degrees_east"}),
        "lat": (("lat",), lat, {"units": "degrees_north"}),
    }
    return [save(folder / "gebco.nc", xr.Dataset(fields))], {}


def _geopackage(folder: Path) -> Prepared:
    """The real land polygons in UTM, as a GeoPackage."""
    _, _, wkb, _ = pyogrio.raw.read(SHARED / "maps/whitsunday_land_osm.geojson")
    turn = Transformer.from_crs(4326, 32755, always_xy=True)
    shapes = shapely.transform(shapely.from_wkb(wkb), lambda p: np.stack(turn.transform(*p.T[:2]), axis=1))
    path, plain = folder / "land_utm.gpkg", set(shapely.get_type_id(shapes)) == {3}
    pyogrio.raw.write(path, shapely.to_wkb(shapes), [], [], driver="GPKG", crs="EPSG:32755",
                      geometry_type="Polygon" if plain else "MultiPolygon",
                      promote_to_multi=not plain)  # fmt: skip
    return [path], {}


def _world_file(folder: Path) -> Prepared:
    paths, options = copied("maps/whitsunday_hook_passage.png")(folder)
    paths[0].with_suffix(".pgw").write_text("10\n0\n0\n-10\n697205\n7774095\n")
    return paths, options


_HOOK = Box(Site(*Transformer.from_crs(32755, 4326, always_xy=True).transform(702_200.0, 7_769_100.0)),
            (3400.0, 4300.0), 10.0)  # fmt: skip
_HAMILTON = Box(Site(148.98, -20.33), (2000.0, 2000.0), 10.0)
_LAND = Box(Site(148.96, -20.22), (8000.0, 8000.0), 20.0)
_OBAN = Box(Site(-5.66, 56.43), (4000.0, 4000.0), 100.0)
_FJORD = Box(Site(5.6756, 59.0332), (250.0, 250.0), 10.0)
_NORKYST = Box(Site(5.99, 55.947), (2500.0, 2500.0), 50.0)
_ARCTIC = Box(Site(17.6224, 74.025), (60_000.0, 60_000.0), 2000.0)
_ROSE = Box(Site(-150.0, 20.0), (300_000.0, 300_000.0), 10_000.0)
_UTM = Box(Site(5.49, 59.975), (1500.0, 2500.0), 50.0)
_GREENWICH = Box(Site(0.05, 50.4), (15_000.0, 15_000.0), 250.0)
_WORLD = Box(Site(10.5, 42.2), (90_000.0, 90_000.0), 1000.0)


def _floor(
    name: str, origin: str, prepare: Any, box: Box, expect: Any, exact: float = 1e-2,
    variables: tuple[str, ...] = (), **options: Any,
) -> Rasters:  # fmt: skip
    def read(path: Path) -> np.ndarray:
        return read_bathymetry(path, box.site, box.extent, keep_shoals=False, **options).depth

    return Rasters(name, "sea bed", origin, prepare, read, lambda path: expect(path, box), exact, variables)


def _real(kind: str, name: str, read: Any, expect: Any) -> Rasters:
    return Rasters(Path(name).name, kind, "real", copied(name), read, expect)


RASTERS = (
    _floor("oban_gebco2020.tif", "real", copied("bathymetry/oban_gebco2020.tif"), _OBAN, tiff_depth),
    _floor("etopo60_rose.nc", "real", copied("elsewhere/etopo60_rose.nc"), _ROSE,
           lambda p, b: axes_depth(p, ("ROSE", "ETOPO60X", "ETOPO60Y"), b, -1.0),
           variables=("ROSE", "ROSE", "ETOPO60X", "ETOPO60Y")),
    _floor("norfjords160_roms_native_24h.nc, h", "real", copied("currents/norfjords160_roms_native_24h.nc"),
           _FJORD, lambda p, b: grid_depth(p, ("h", "lon_rho", "lat_rho"), b, "mask_rho"), 0.05,
           ("h", "h", "lon_rho", "lat_rho")),
    _floor("norkyst_v3_800m_5h.nc, h", "real", copied("currents/norkyst_v3_800m_5h.nc"), _NORKYST,
           lambda p, b: grid_depth(p, ("h", "lon", "lat"), b), 0.05, ("h", "h", "lon", "lat")),
    _floor("arctic20_polar_stereographic.nc, h", "real", copied("elsewhere/arctic20_polar_stereographic.nc"),
           _ARCTIC, lambda p, b: grid_depth(p, ("h", "longitude", "latitude"), b), 1.0,
           ("h", "h", "longitude", "latitude")),
    _floor("UTM GeoTIFF, packed in decimetres", "made", _utm_floor, _UTM, tiff_depth, positive="up"),
    _floor("GEBCO NetCDF across Greenwich, 0 to 360", "made", _gebco, _GREENWICH,
           lambda p, b: axes_depth(p, ("elevation", "lon", "lat"), b, -1.0)),
    _real("chart", "maps/whitsunday_hook_passage_class.tif", partial(classes, box=_HOOK),
          partial(tiff_classes, box=_HOOK)),
    _real("chart", "maps/whitsunday_hamilton_dent_class.tif", partial(classes, box=_HAMILTON),
          partial(tiff_classes, box=_HAMILTON)),
    *(_real("chart", name, partial(land, box=box), partial(rasterized, box=box)) for name, box in (
        ("maps/whitsunday_land_osm.geojson", _LAND), ("maps/whitsunday_reefs_eatlas.geojson", _LAND),
        ("elsewhere/natural_earth_110m_land.geojson", _WORLD))),
    Rasters("whitsunday_land_osm in UTM, GeoPackage", "chart", "cut", _geopackage,
            partial(land, box=_LAND), partial(rasterized, box=_LAND)),
    _real("picture", "maps/whitsunday_hook_passage_rgb.tif", picture, pixels),
    _real("picture", "maps/whitsunday_hamilton_dent_rgb.tif", picture, pixels),
    _real("picture", "elsewhere/world_rgb_lzw_band.tif", partial(picture, crs=4326), pixels),
    _real("picture", "maps/whitsunday_hook_passage.png", partial(picture, crs=32755), pixels),
    Rasters("whitsunday_hook_passage.png with a world file", "picture", "cut", _world_file,
            partial(picture, crs=32755), pixels),
)  # fmt: skip
