"""A small sea area with all its files, sound and quick to read, for tests that spoil one thing of it."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import yaml

CENTRE = (148.96, -20.34)
SCENARIO = {
    "site": {"longitude": CENTRE[0], "latitude": CENTRE[1], "departure": "2026-03-01T00:00:00Z"},
    "area": {"lower": [-2000, -2000, 0], "upper": [2000, 2000, 30]},
    "chart": {"source": "polygons", "file": "coast.geojson", "pixel_size": 100, "no_go": "closed.geojson"},
    "bathymetry": {"source": "file", "file": "bed.nc", "pixel_size": 100},
    "current": {"source": "file", "files": "tide.nc"},
    "mission": {
        "jobs": "jobs.csv",
        "start": [-1500, -1500, 5],
        "goal": [1500, 1500, 5],
        "time_available": 3600,
    },
}
JOBS = "north,east,depth,priority,duration,name\n-500,1000,5,2,60,a\n1000,-800,10,3,30,b\n"


class SmallSite:
    """The files of the area in a folder, and ways to spoil them."""

    def __init__(self, folder: Path, like: Path | None = None) -> None:
        """Write the files to a new folder, or copy them from one where they are."""
        self.folder, self.plain = folder, json.loads(json.dumps(SCENARIO))
        if like is not None:
            shutil.copytree(like, folder)
            return
        folder.mkdir()
        self.polygons("coast.geojson", _ring(148.955, -20.345, 0.004))
        self.polygons("closed.geojson", _ring(148.966, -20.338, 0.002))
        self.netcdf("bed.nc", bed())
        self.netcdf("tide.nc", tide())
        self.write("jobs.csv", JOBS)
        self.save()

    def save(self) -> None:
        self.write("scenario.yaml", yaml.safe_dump(self.plain, sort_keys=False))

    def set(self, **sections: Any) -> None:
        """Change some fields of sections; a section that is None goes."""
        for name, fields in sections.items():
            self.plain[name] = self.plain.get(name, {}) | fields if fields is not None else None
        self.plain = {name: part for name, part in self.plain.items() if part is not None}
        self.save()

    def write(self, name: str, content: str | bytes) -> None:
        (self.folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    def folder_instead(self, name: str) -> None:
        (self.folder / name).unlink()
        (self.folder / name).mkdir()

    def missing(self, name: str) -> None:
        (self.folder / name).unlink()

    def cut(self, name: str, share: float) -> None:
        """Keep the first part of a file."""
        content = (self.folder / name).read_bytes()
        self.write(name, content[: int(len(content) * share)])

    def polygons(self, name: str, *rings: list) -> None:
        features = [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
            for ring in rings
        ]
        self.write(name, json.dumps({"type": "FeatureCollection", "features": features}))

    def netcdf(self, name: str, dataset: xr.Dataset) -> None:
        dataset.to_netcdf(self.folder / name, engine="h5netcdf")

    def tide(self, change: Callable[[xr.Dataset], xr.Dataset]) -> None:
        self.netcdf("tide.nc", change(tide()))

    def bed(self, change: Callable[[xr.Dataset], xr.Dataset]) -> None:
        self.netcdf("bed.nc", change(bed()))

    def raster(self, picture: bytes | None, world: str | None = None, **fields: Any) -> None:
        """A chart from a picture with a world file."""
        self.plain["chart"] = {"source": "raster", "file": "chart.png", "pixel_size": 100} | fields
        self.save()
        if picture is not None:
            self.write("chart.png", picture)
        if world is not None:
            self.write("chart.pgw", world)


def bed() -> xr.Dataset:
    axes = _axes()
    shape = tuple(len(axis) for axis in axes.values())
    stated = {"standard_name": "sea_floor_depth_below_sea_level", "units": "m", "positive": "down"}
    return xr.Dataset({"depth": (tuple(axes), np.full(shape, 60.0), stated)}, _coordinates(axes))


def tide() -> xr.Dataset:
    """Two hours of an even current at two depths."""
    axes = _axes()
    shape = (3, 2, *(len(axis) for axis in axes.values()))
    dims = ("time", "depth", *axes)
    fields = {
        name: (dims, np.full(shape, speed), {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"})
        for name, way, speed in (("uo", "eastward", 0.3), ("vo", "northward", 0.1))
    }
    coordinates = _coordinates(axes) | {
        "time": ("time", [0.0, 1.0, 2.0], {"units": "hours since 2026-03-01T00:00:00Z"}),
        "depth": ("depth", [0.0, 40.0], {"units": "m", "positive": "down"}),
    }
    return xr.Dataset(fields, coordinates)


def _axes() -> dict[str, np.ndarray]:
    return {
        "latitude": CENTRE[1] + np.linspace(-0.03, 0.03, 7),
        "longitude": CENTRE[0] + np.linspace(-0.03, 0.03, 7),
    }


def _coordinates(axes: dict[str, np.ndarray]) -> dict:
    units = {"latitude": "degrees_north", "longitude": "degrees_east"}
    return {name: (name, axis, {"standard_name": name, "units": units[name]}) for name, axis in axes.items()}


def _ring(west: float, south: float, size: float) -> list:
    east, north = west + size, south + size
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]
