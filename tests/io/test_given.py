"""Objects in place of the files that a scenario names: the area is the same."""

import json

import jax
import numpy as np
import pytest
import xarray as xr

import auvplan as ap
from auvplan.ocean.chart import ChartError
from tests.io.geo.files import feature, write_geojson
from tests.io.refusals import refusal
from tests.io.small_site import SmallSite


class Frame:
    """What has features, as a GeoDataFrame does: with tuples, not lists."""

    def __init__(self, collection: dict) -> None:
        self.__geo_interface__ = json.loads(json.dumps(collection), object_hook=self._with_tuples)

    @staticmethod
    def _with_tuples(part: dict) -> dict:
        def frozen(value):
            return tuple(map(frozen, value)) if isinstance(value, list) else value

        return {k: frozen(v) if k == "coordinates" else v for k, v in part.items()}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    site = SmallSite(tmp_path_factory.mktemp("given") / "site")
    places = [[148.955, -20.350], [148.967, -20.350]]
    jobs = [feature("Point", at, name=name, depth=5) for name, at in zip("ab", places, strict=True)]
    write_geojson(site.folder / "jobs.geojson", *jobs)
    write_geojson(site.folder / "buoys.geojson", feature("Point", places[0], radius=20))
    site.set(mission={"jobs": "jobs.geojson"}, obstacles={"file": "buoys.geojson"})
    return site


def features(site, name):
    return json.loads((site.folder / name).read_text())


def test_an_area_of_objects_is_that_of_the_files(site):
    scenario = ap.load_scenario(site.folder / "scenario.yaml")
    with xr.open_dataset(site.folder / "tide.nc") as tide, xr.open_dataset(site.folder / "bed.nc") as bed:
        given = {"current.files": tide.load(), "bathymetry.file": bed.load()}
    given |= {
        "chart.file": Frame(features(site, "coast.geojson")),
        "chart.no_go": features(site, "closed.geojson"),
        "obstacles.file": Frame(features(site, "buoys.geojson")),
        "mission.jobs": Frame(features(site, "jobs.geojson")),
    }
    fields = [field.split(".") for field in given]
    elsewhere = ap.load_scenario(site.folder / "scenario.yaml")
    for section, field in fields:
        part = getattr(elsewhere, section).model_copy(update={field: "nowhere"})
        elsewhere = elsewhere.model_copy(update={section: part})
    of_files, of_objects = ap.load_area(scenario), ap.load_area(elsewhere, given=given)
    for name in ("chart", "coast", "seabed", "forecast", "truth"):
        one, other = (jax.tree.leaves(getattr(area, name)) for area in (of_files, of_objects))
        for left, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(left, right, err_msg=name)
    assert of_objects.jobs is not None
    assert of_objects.jobs.points == of_files.jobs.points
    assert of_objects.obstacles == of_files.obstacles
    assert of_objects.site == of_files.site
    assert [zone.name for zone in of_objects.zones] == [zone.name for zone in of_files.zones]


@pytest.mark.parametrize("pixel_size", [None, 110.0, 400.0])
@pytest.mark.parametrize("mesh", [False, True])
def test_the_bed_of_a_current_keeps_its_shoals(mesh, pixel_size):
    """Pinnacles of one point, where points are as far apart as pixels, farther, or nearer."""
    axes = {"lat": 50.0 + np.linspace(-0.02, 0.02, 25), "lon": np.linspace(-0.03, 0.03, 25)}
    floor = np.where(np.random.default_rng(4).random((25, 25)) < 0.05, 6.0, 60.0)
    time = ("time", np.array(["2026-03-01T00", "2026-03-02T00"], "datetime64[ns]"))
    flow = {name: (("time", *axes), np.full((2, 25, 25), 0.1), {"units": "m s-1"}) for name in ("uo", "vo")}
    bed = ("lat", "lon"), floor, {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
    data = xr.Dataset({**flow, "deptho": bed}, {"time": time, **axes})
    data["lat"].attrs, data["lon"].attrs = {"units": "degrees_north"}, {"units": "degrees_east"}
    if mesh:
        data = data.stack(node=["lat", "lon"]).reset_index("node").reset_coords(["lat", "lon"])
    scenario = ap.Scenario.model_validate(
        {
            "site": {"longitude": 0.0, "latitude": 50.0, "departure": "2026-03-01T03:00:00Z"},
            "area": {"lower": [-1500, -1500, 0], "upper": [1500, 1500, 50]},
            "chart": {"source": "none"},
            "bathymetry": {"source": "current", "pixel_size": pixel_size},
            "current": {"source": "file", "files": "given.nc"},
        }
    )
    area = ap.load_area(scenario, given={"current.files": data})
    latitude, longitude = np.meshgrid(*axes.values(), indexing="ij")
    north, east = area.site.to_local(longitude, latitude)
    among = (np.abs(north) < 1500 - 200) & (np.abs(east) < 1500 - 200)
    assert (np.asarray(area.seabed.depth_at(north, east)) <= floor + 1e-3)[among].all()
    assert float(area.seabed.depth.max()) == 60.0
    assert float(area.seabed.depth.min()) > 0.0


def test_what_is_wrong_with_an_object_names_it(site):
    scenario = ap.load_scenario(site.folder / "scenario.yaml")
    words, box = "the given dict: 'Box' is no type of GeoJSON", {"chart.file": {"type": "Box"}}
    assert refusal(ChartError, words, ap.load_area, scenario, given=box).field == "chart.file"
    words = r"given: 'chart\.image' cannot be given: current\.files, "
    refusal(ValueError, words, ap.load_area, scenario, given={"chart.image": 0})


def test_what_is_given_is_not_confused_with_what_was_given_before(site):
    """Areas of one scenario, read one after the other, with other land and other closed areas."""
    scenario = ap.load_scenario(site.folder / "scenario.yaml")
    land, closed = features(site, "coast.geojson"), features(site, "closed.geojson")
    first, second, third = (
        ap.load_area(scenario, given={"chart.file": coast, "chart.no_go": zones})
        for coast, zones in ((land, closed), (closed, closed), (land, land))
    )
    of_files = ap.load_area(scenario)
    np.testing.assert_array_equal(first.chart.passability, of_files.chart.passability)
    for other in (second, third):
        assert (np.asarray(first.chart.passability) != np.asarray(other.chart.passability)).any()
    assert (np.asarray(first.coast.passability) != np.asarray(second.coast.passability)).any()
