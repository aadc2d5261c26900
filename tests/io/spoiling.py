"""Ways to spoil the files of a small site, each a function that makes one that does it."""

import json
import struct
import zlib

import h5py
import numpy as np

UNITS = {
    "time": "hours since 2026-03-01",
    "depth": "m",
    "latitude": "degrees_north",
    "longitude": "degrees_east",
}


def png_head(width, height):
    """The beginning of a picture that claims a size."""
    size = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(100))
    chunks = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in ((b"IHDR", size), (b"IDAT", pixels))
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def nested(depth):
    return "[" * depth + "]" * depth


def ring_of(*places):
    return [list(place) for place in (*places, places[0])]


def stated(name, **attributes):
    """A change of a variable's attributes."""

    def change(data):
        data[name].attrs.update(attributes)
        return data

    return change


def moved(name, by):
    """A change of a coordinate's values."""
    return lambda data: data.assign_coords({name: (name, by(data[name].values), data[name].attrs)})


def everywhere(name, value):
    return lambda data: data.assign(
        {name: (data[name].dims, np.full(data[name].shape, value), data[name].attrs)}
    )


def huge(site, name, variable, shape):
    """A file whose head claims a size, and which holds nothing."""
    dims = ("time", "depth", "latitude", "longitude")[-len(shape) :]
    with h5py.File(site.folder / name, "w") as file:
        for dim, size in zip(dims, shape, strict=True):
            axis = file.create_dataset(dim, (size,), "f4", chunks=(1024,) if size > 1024 else None)
            axis.make_scale(dim)
            axis.attrs["units"] = UNITS[dim]
        for one in variable:
            field = file.create_dataset(one, shape, "f4", chunks=tuple(min(size, 64) for size in shape))
            field.attrs["units"] = "m s-1" if name == "tide.nc" else "m"
            for k, dim in enumerate(dims):
                field.dims[k].attach_scale(file[dim])


def scenario(text):
    return lambda site: site.write("scenario.yaml", text)


def sections(**changes):
    return lambda site: site.set(**changes)


def file(name, content):
    return lambda site: site.write(name, content)


def gone(name):
    return lambda site: site.missing(name)


def folder(name):
    return lambda site: site.folder_instead(name)


def cut(name, share):
    return lambda site: site.cut(name, share)


def tide(change):
    return lambda site: site.tide(change)


def bed(change):
    return lambda site: site.bed(change)


def raster(*given, **fields):
    return lambda site: site.raster(*given, **fields)


def coast(*rings):
    return lambda site: site.polygons("coast.geojson", *rings)


def geojson(name, **members):
    return lambda site: site.write(name, json.dumps(members))


def jobs(text):
    return lambda site: site.write("jobs.csv", text)


def feature(kind, coordinates, **properties):
    """A change to jobs by GeoJSON, of one feature."""

    def spoil(site):
        site.set(mission={"jobs": "jobs.geojson"})
        geometry = {"type": kind, "coordinates": coordinates}
        site.write(
            "jobs.geojson", json.dumps({"type": "Feature", "geometry": geometry, "properties": properties})
        )

    return spoil
