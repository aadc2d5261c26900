"""Files with some bytes changed or cut off are read or refused in one line, never anything else."""

import numpy as np
import pytest

from auvplan.io.geo import (
    GeoError,
    chart_from_polygons,
    chart_from_raster,
    read_bathymetry,
    read_jobs,
    read_zones,
)
from auvplan.ocean.chart import ChartError
from tests.io.geo import sea_floors
from tests.io.geo.files import SITE, feature, ring, write_geojson, write_geotiff

BOX = {"lower": (-50.0, -50.0), "upper": (50.0, 50.0)}
TABLE = "name,north,east,line,priority,duration,depth\nreef,12,35,,3,60,12\n,10,20,a,2,,5\n,10,120,a,,90,6\n"


def picture(path):
    values = np.full((30, 40, 3), (40, 95, 160), np.uint8)
    values[:10] = 120, 140, 80
    values += np.random.default_rng(0).integers(0, 9, values.shape).astype(np.uint8)
    return write_geotiff(path, values, corner=(148.958, -20.3385), scale=(1e-4, 1e-4), compress="deflate")


def polygons(path):
    return write_geojson(path, feature("Polygon", [ring((0, 0), (0, 50), (50, 0))]))


def table(path):
    path.write_text(TABLE)
    return path


READERS = {
    "picture.tif": (picture, lambda path: chart_from_raster(path, SITE, **BOX)),
    "grid.nc": (
        sea_floors.write_grid,
        lambda path: read_bathymetry(path, sea_floors.SITE, **sea_floors.AREA),
    ),
    "classic.nc": (
        lambda path: sea_floors.write_grid(path, form="NETCDF3_CLASSIC"),
        lambda path: read_bathymetry(path, sea_floors.SITE, **sea_floors.AREA),
    ),
    "land.geojson": (polygons, lambda path: chart_from_polygons(path, SITE, **BOX)),
    "zones.geojson": (polygons, lambda path: read_zones(path, SITE)),
    "jobs.csv": (table, lambda path: read_jobs(path, SITE)),
}


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("name", READERS)
def test_damaged_files(tmp_path, name):
    write, read = READERS[name]
    whole = write(tmp_path / name).read_bytes()
    read(tmp_path / name)
    rng, said = np.random.default_rng(1), []
    for trial in range(30):
        damaged = np.frombuffer(whole, np.uint8).copy()
        places = rng.integers(0, len(whole) if trial % 2 else min(len(whole), 400), rng.integers(1, 5))
        damaged[places] = rng.integers(0, 256, len(places))
        end = rng.integers(0, len(whole)) if trial % 5 == 0 else len(whole)
        (tmp_path / name).write_bytes(damaged[:end].tobytes())
        try:
            read(tmp_path / name)
        except (GeoError, ChartError) as error:
            said.append(str(error))
    assert said
    assert all(name in line and "\n" not in line and len(line) < 600 for line in said)
