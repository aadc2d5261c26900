"""A small sea area with all its files, sound and quick to read, for tests that spoil one thing of it."""

import json
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
import yaml

X, Y = CENTRE = (148.96, -20.34)
SCENARIO = {
    "site": {"longitude": X, "latitude": Y, "departure": "2026-03-01T00:00:00Z"},
    "area": {"lower": [-2000, -2000, 0], "upper": [2000, 2000, 30]},
    "chart": {"source": "polygons", "file": "coast.geojson", "pixel_size": 100, "no_go": "closed.geojson"},
    "bathymetry": {"source": "file", "file": "bed.nc", "pixel_size": 100},
    "current": {"source": "file", "files": "tide.nc"},
    "mission": {
        "jobs": "jobs.csv",
        "start": [-1500, -1500, 5],
        "goal": [1500, -500, 5],
        "time_available": 3600,
    },
}
JOBS = "north,east,depth,priority,duration,name\n-500,1000,5,2,60,a\n1000,-800,10,3,30,b\n"
UNITS = {
    "time": "hours since 2026-03-01",
    "depth": "m",
    "latitude": "degrees_north",
    "longitude": "degrees_east",
}


class SmallSite:
    """The files of the area in a folder, and ways to spoil them."""

    def __init__(self, folder: Path, like: Path | None = None) -> None:
        """Write the files to a new folder, or copy them from one where they are."""
        self.folder, self.plain = folder, json.loads(json.dumps(SCENARIO))
        if like is not None:
            shutil.copytree(like, folder)
            return
        folder.mkdir()
        self.polygons("coast.geojson", square(148.955, -20.345, 0.004))
        self.polygons("closed.geojson", square(148.966, -20.338, 0.002))
        self.bed(lambda data: data)
        self.tide(lambda data: data)
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

    def put(self, **sections: Any) -> None:
        """Replace whole sections."""
        self.plain |= sections
        self.set()

    def text(self, old: str, new: str) -> None:
        """Change the scenario's text, to what YAML would write in another way."""
        text = (self.folder / "scenario.yaml").read_text()
        assert old in text
        self.write("scenario.yaml", text.replace(old, new))

    def write(self, name: str, content: str | bytes) -> None:
        (self.folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    def missing(self, name: str) -> None:
        (self.folder / name).unlink()

    def folder_instead(self, name: str) -> None:
        self.missing(name)
        (self.folder / name).mkdir()

    def cut(self, name: str, share: float) -> None:
        """Keep the first part of a file."""
        content = (self.folder / name).read_bytes()
        self.write(name, content[: int(len(content) * share)])

    def features(self, name: str, kind: str, /, *coordinates: Any, **properties: Any) -> None:
        """Write a feature for each of some coordinates."""
        features = [
            {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": one}}
            for one in coordinates
        ]
        self.write(name, json.dumps({"type": "FeatureCollection", "features": features}))

    def polygons(self, name: str, *rings: list) -> None:
        self.features(name, "Polygon", *([ring] for ring in rings))

    def obstacles(self, *places: list, **properties: Any) -> None:
        self.set(obstacles={"file": "obstacles.geojson"})
        self.features("obstacles.geojson", "Point", *places, **properties)

    def tide(self, change: Callable[[xr.Dataset], xr.Dataset]) -> None:
        """Two hours of an even current at two depths, changed."""
        dims = ("time", "depth", "latitude", "longitude")
        fields = {
            name: (dims, np.full((3, 2, 7, 7), speed), {"standard_name": f"{way}_sea_water_velocity",
                                                        "units": "m s-1"})
            for name, way, speed in (("uo", "eastward", 0.3), ("vo", "northward", 0.1))
        }  # fmt: skip
        coordinates = {
            "time": ("time", [0.0, 1.0, 2.0], {"units": "hours since 2026-03-01T00:00:00Z"}),
            "depth": ("depth", [0.0, 40.0], {"units": "m", "positive": "down"}),
        }
        change(xr.Dataset(fields, coordinates | axes())).to_netcdf(self.folder / "tide.nc", engine="scipy")

    def bed(self, change: Callable[[xr.Dataset], xr.Dataset]) -> None:
        """An even sea bed, changed."""
        stated = {"standard_name": "sea_floor_depth_below_sea_level", "units": "m", "positive": "down"}
        data = xr.Dataset({"depth": (("latitude", "longitude"), np.full((7, 7), 60.0), stated)}, axes())
        change(data).to_netcdf(self.folder / "bed.nc", engine="scipy")

    def huge(self, name: str, variables: tuple[str, ...], shape: tuple[int, ...]) -> None:
        """A file whose head claims a size, and which holds nothing."""
        dims = ("time", "depth", "latitude", "longitude")[-len(shape) :]
        with h5py.File(self.folder / name, "w") as file:
            for dim, size in zip(dims, shape, strict=True):
                axis = file.create_dataset(dim, (size,), "f4", chunks=(1024,) if size > 1024 else None)
                axis.make_scale(dim)
                axis.attrs["units"] = UNITS[dim]
            for one in variables:
                field = file.create_dataset(one, shape, "f4", chunks=tuple(min(size, 64) for size in shape))
                field.attrs["units"] = "m s-1" if name == "tide.nc" else "m"
                for k, dim in enumerate(dims):
                    field.dims[k].attach_scale(file[dim])

    def raster(self, picture: bytes | None, world: str | None = None, **fields: Any) -> None:
        """A chart from a picture with a world file."""
        self.put(chart={"source": "raster", "file": "chart.png", "pixel_size": 100} | fields)
        if picture is not None:
            self.write("chart.png", picture)
        if world is not None:
            self.write("chart.pgw", world)


def axes() -> dict:
    steps = np.linspace(-0.03, 0.03, 7)
    middles = {"latitude": Y, "longitude": X}
    return {
        name: (name, middle + steps, {"standard_name": name, "units": UNITS[name]})
        for name, middle in middles.items()
    }


def ring_of(*places: tuple[float, float]) -> list:
    return [list(place) for place in (*places, places[0])]


def square(west: float, south: float, size: float) -> list:
    east, north = west + size, south + size
    return ring_of((west, south), (east, south), (east, north), (west, north))


def png_head(width: int, height: int, pixels: bytes = zlib.compress(bytes(100))) -> bytes:
    """The beginning of a picture that claims a size."""
    size = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in ((b"IHDR", size), (b"IDAT", pixels))
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)
