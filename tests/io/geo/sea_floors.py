"""A sea floor known in closed form, and files of it."""

import numpy as np
import xarray as xr

from auvplan.io.geo import read_bathymetry
from auvplan.io.geo.grid import Extent
from auvplan.site import Site
from tests.io.geo.files import geographic

SITE = Site(-5.66, 56.43, origin=(2000.0, 1000.0))
AREA = {"lower": (-1000.0, -1500.0), "upper": (4000.0, 3000.0)}
METRES = {"units": "m"}
LATITUDE, LONGITUDE = 56.36 + 0.01 * np.arange(14), -5.74 + 0.02 * np.arange(9)


def sea_floor(longitude, latitude):
    """Depth, m: a plane that a bilinear interpolation gives back, with land in the north-west."""
    return 40.0 + 900.0 * (longitude + 5.66) - 700.0 * (latitude - 56.43)


def grid(name="elevation", *, sign=-1.0, attributes=METRES, values=None, lat=LATITUDE, lon=LONGITUDE):
    """A data set of `sea_floor` on two axes."""
    near = (np.asarray(lon) + 180.0 + 5.66) % 360.0 - 180.0 - 5.66
    if values is None:
        values = sign * sea_floor(near[None, :], np.asarray(lat)[:, None])
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    return xr.Dataset({name: (("lat", "lon"), values, attributes)}, axes)


def write_grid(path, name="elevation", *, form=None, **options):
    """A NetCDF file of it."""
    engine = "h5netcdf" if form is None else "scipy"
    grid(name, **options).to_netcdf(path, engine=engine, format=form)
    return path


def floor_of(
    source, pixel_size=None, site=SITE, lower=AREA["lower"], upper=AREA["upper"], keep_shoals=False, **options
):
    """What is interpolated at the centres of pixels."""
    options["keep_shoals"] = keep_shoals
    return read_bathymetry(source, site, Extent(lower, upper, pixel_size), **options)


def expected(bathymetry, site=SITE):
    """`sea_floor` at the centres of the pixels."""
    size, (south, west) = bathymetry.pixel_size, bathymetry.origin
    north = south + (np.arange(bathymetry.depth.shape[0]) + 0.5) * size
    east = west + (np.arange(bathymetry.depth.shape[1]) + 0.5) * size
    places = geographic(*np.meshgrid(north, east, indexing="ij"), site)
    return places[..., 0], places[..., 1]
