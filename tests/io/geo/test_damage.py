"""Files with some bytes changed or cut off are read or refused in one line, never anything else."""

import numpy as np
import pytest
from PIL import Image

from auvplan.io.currents import read_current
from auvplan.io.geo import (
    GeoError,
    chart_from_polygons,
    chart_from_raster,
    read_jobs,
    read_zones,
)
from auvplan.io.geo.grid import Extent
from auvplan.io.geo.s57 import read_cells
from auvplan.ocean.chart import Chart, ChartError
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.whitsunday import render
from tests.io.currents import samples
from tests.io.geo import sea_floors, test_s57
from tests.io.geo.enc_cells import write_cell
from tests.io.geo.files import SITE, feature, ring, write_geojson, write_geotiff, written

BOX = {"lower": (-50.0, -50.0), "upper": (50.0, 50.0)}
TABLE = "name,north,east,line,priority,duration,depth\nreef,12,35,,3,60,12\n,10,20,a,2,,5\n,10,120,a,,90,6\n"


def picture(path):
    values = np.full((30, 40, 3), (40, 95, 160), np.uint8)
    values[:10] = 120, 140, 80
    values += np.random.default_rng(0).integers(0, 9, values.shape).astype(np.uint8)
    return write_geotiff(path, values, corner=(148.958, -20.3385), scale=(1e-4, 1e-4), compress="deflate")


def image(path):
    Image.fromarray(render(100)[:30, :30]).save(path)
    return path


def current(path):
    return samples.write(samples.regular(), path)


def read_box(path):
    read_current(path, samples.SITE, **samples.BOX).source.close()


def polygons(path):
    return write_geojson(path, feature("Polygon", [ring((0, 0), (0, 50), (50, 0))]))


READERS = {
    "picture.tif": (picture, lambda path: chart_from_raster(path, SITE, Extent(**BOX))),
    **dict.fromkeys(("chart.png", "chart.jpg", "chart.tif"), (image, Chart.from_image)),
    "grid.nc": (sea_floors.write_grid, sea_floors.floor_of),
    "classic.nc": (lambda path: sea_floors.write_grid(path, form="NETCDF3_CLASSIC"), sea_floors.floor_of),
    "current.nc": (current, read_box),
    "current.nc3": (current, read_box),
    "A.000": (
        lambda path: write_cell(path, test_s57.bay()),
        lambda path: read_cells(path, test_s57.SITE, Extent(pixel_size=100.0, **test_s57.BOX), deepest=15.0),
    ),
    "land.geojson": (polygons, lambda path: chart_from_polygons(path, SITE, Extent(**BOX))),
    "zones.geojson": (polygons, lambda path: read_zones(path, SITE)),
    "jobs.csv": (lambda path: written(path, TABLE), lambda path: read_jobs(path, SITE)),
}


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("name", READERS)
def test_damaged_files(tmp_path, name):
    write, read = READERS[name]
    whole = write(tmp_path / name).read_bytes()
    read(tmp_path / name)
    rng, said = np.random.default_rng(1), []
    for trial in range(15 if name.startswith("chart") else 30):
        damaged = np.frombuffer(whole, np.uint8).copy()
        reach = len(whole) if trial % 2 else min(len(whole), 6000 if "current" in name else 400)
        places = rng.integers(0, reach, rng.integers(1, 5) if reach < 6000 else 20)
        damaged[places] = rng.integers(0, 256, len(places))
        end = rng.integers(0, len(whole)) if trial % 5 == 0 else len(whole)
        (tmp_path / name).write_bytes(damaged[:end].tobytes())
        try:
            read(tmp_path / name)
        except (GeoError, ChartError, CurrentError) as error:
            said.append(str(error))
    assert said
    assert all(name in line and "\n" not in line and len(line) < 600 for line in said)
