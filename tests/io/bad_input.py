"""A corpus of malformed and hostile input: what is done to a small site, and what is to be said of it."""

import numpy as np

from tests.io.small_site import JOBS
from tests.io.spoiling import (
    bed,
    coast,
    cut,
    everywhere,
    feature,
    file,
    folder,
    geojson,
    gone,
    huge,
    jobs,
    moved,
    nested,
    png_head,
    raster,
    ring_of,
    scenario,
    sections,
    stated,
    tide,
)

BOMB = "a: &a [x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}, *{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
NAN = float("nan")
SQUARE = ring_of((148.95, -20.35), (148.96, -20.35), (148.96, -20.34), (148.95, -20.34))
STAR = ring_of(
    *(
        (148.95 + 0.01 * np.cos(turn), -20.35 + 0.01 * np.sin(turn))
        for turn in np.arange(41) * 40.0 * np.pi / 41
    )
)
WIDE = ring_of((148.9, -20.3425), (149.0, -20.3425), (149.0, -20.3415), (148.9, -20.3415))

#: What is done to the files, and words that the line must hold: the file, and the field or variable.
CASES = {
    # the text of the scenario
    "scenario missing": (gone("scenario.yaml"), "scenario.yaml", "No such file"),
    "scenario a folder": (folder("scenario.yaml"), "scenario.yaml", "directory"),
    "scenario empty": (scenario(""), "scenario.yaml", "mapping"),
    "scenario binary": (scenario(bytes(range(256))), "scenario.yaml", "not a text file"),
    "scenario of control characters": (scenario("name: \x07\x1b[31m"), "scenario.yaml:1", "YAML"),
    "scenario huge": (scenario("#" * 300_000), "scenario.yaml", "larger"),
    "scenario a list": (scenario("- a\n- b\n"), "scenario.yaml:1", "mapping"),
    "scenario two documents": (scenario("name: a\n---\nname: b\n"), "scenario.yaml:2", "document"),
    "YAML unclosed": (scenario("name: a\nvehicle: {speed: 2"), "scenario.yaml:2", "YAML"),
    "YAML bomb": (scenario(BOMB), "scenario.yaml:2", "aliases"),
    "YAML tag": (
        scenario("name: !!python/object/apply:os.system ['true']"), "scenario.yaml:1", "name", "tag",
    ),
    "YAML merge": (scenario("<<: {name: a}"), "scenario.yaml:1", "key"),
    "YAML deep": (scenario(f"name: {nested(5000)}"), "scenario.yaml:1", "deeply"),
    "YAML key twice": (scenario("name: a\nname: b\n"), "scenario.yaml:2", "name", "twice"),
    "YAML key a list": (scenario("? [a, b]\n: c\n"), "scenario.yaml:1", "key"),
    "YAML number beyond reading": (scenario(f"vehicle: {{speed: {'9' * 6000}}}"), "scenario.yaml:1", "speed"),
    "key with a line break": (scenario('"a\\nb": 1\n'), "scenario.yaml:1", "unknown key"),
    # its fields
    "unknown key": (sections(mission={"prioritys": [1, 2]}), "scenario.yaml:", "did you mean 'priority'"),
    "unknown section": (sections(vehicles={"speed": 1}), "scenario.yaml:", "did you mean 'vehicle'"),
    "negative speed": (sections(vehicle={"speed": -1}), "scenario.yaml:", "vehicle.speed", "-1"),
    "speed NaN": (sections(vehicle={"speed": NAN}), "scenario.yaml:", "vehicle.speed", "nan"),
    "time infinite": (
        sections(mission={"time_available": np.inf}), "scenario.yaml:", "mission.time_available",
    ),
    "speed in words": (sections(vehicle={"speed": "2 knots"}), "scenario.yaml:", "vehicle.speed", "2 knots"),
    "speed a mapping": (sections(vehicle={"speed": {}}), "scenario.yaml:", "vehicle.speed"),
    "area upside down": (sections(area={"lower": [3000, 0, 0]}), "scenario.yaml:", "area"),
    "departure no date": (sections(site={"departure": "tomorrow"}), "scenario.yaml:", "site.departure"),
    "departure no day": (sections(site={"departure": "2026-02-30"}), "scenario.yaml:", "site.departure"),
    "departure at the beginning of time": (
        sections(site={"departure": "0001-01-01T00:00:00+14:00"}), "scenario.yaml:",
    ),
    "start no place": (
        sections(mission={"start": {"longitude": 1000, "latitude": 0}}),
        "scenario.yaml:", "mission.start", "Earth",
    ),
    "start beyond all numbers": (
        sections(mission={"start": {"longitude": 10**400, "latitude": 0}}), "scenario.yaml:", "mission.start",
    ),
    "start outside": (
        sections(mission={"start": [9000, 0, 5]}), "scenario.yaml:", "mission.start", "outside",
    ),
    "start too deep": (sections(mission={"start": [0, 0, 300]}), "scenario.yaml:", "mission.start", "depths"),
    "no site": (sections(site=None), "scenario.yaml:", "chart.source", "site"),
    "vehicle without depths": (sections(vehicle={"depth_min": 40}), "scenario.yaml:", "vehicle.depth_min"),
    # currents
    "current missing": (gone("tide.nc"), "tide.nc", "no such file"),
    "current a folder": (folder("tide.nc"), "tide.nc", "folder"),
    "current empty": (file("tide.nc", b""), "tide.nc", "NetCDF"),
    "current text": (file("tide.nc", "u,v\n1,2\n"), "tide.nc", "NetCDF"),
    "current half there": (cut("tide.nc", 0.5), "tide.nc", "NetCDF"),
    "current nearly there": (cut("tide.nc", 0.97), "tide.nc", "NetCDF"),
    "current none of a pattern": (sections(current={"files": "*.grb"}), "*.grb", "no such file"),
    "current no files": (sections(current={"files": []}), "no file"),
    "current of other variables": (tide(lambda data: data.drop_vars(["uo", "vo"])), "tide.nc", "no current"),
    "current half of it": (tide(lambda data: data.drop_vars("vo")), "tide.nc", "uo"),
    "current missing everywhere": (tide(everywhere("uo", NAN)), "tide.nc", "land only"),
    "current in kilogrammes": (tide(stated("uo", units="kg")), "tide.nc", "uo", "kg"),
    "current in words": (tide(lambda data: data.assign(uo=data["uo"].astype(str))), "tide.nc", "uo"),
    "current of two shapes": (
        tide(
            lambda data: data.assign(
                vo=data["vo"].isel(latitude=slice(3)).rename(latitude="row").drop_vars("row")
            )
        ),
        "tide.nc", "vo",
    ),
    "current without times": (tide(lambda data: data.drop_vars("time")), "tide.nc", "time"),
    "current of no times": (tide(lambda data: data.isel(time=slice(0, 0))), "tide.nc", "time"),
    "current times in words": (tide(stated("time", units="hours since the war")), "tide.nc", "time"),
    "current backwards": (tide(moved("time", lambda t: t[::-1])), "tide.nc", "time"),
    "current of missing dates": (tide(moved("time", lambda t: t * NAN)), "tide.nc", "time"),
    "current at NaN": (
        tide(moved("longitude", lambda x: np.where(x > 148.98, NAN, x))), "tide.nc", "longitude",
    ),
    "current off the Earth": (tide(moved("latitude", lambda x: x - 90)), "tide.nc", "latitude"),
    "current nowhere near": (tide(moved("longitude", lambda x: x + 5)), "tide.nc", "not covered"),
    "current ends early": (sections(mission={"time_available": 86_400}), "tide.nc", "2026-03-02"),
    "current begins later": (sections(site={"departure": "2026-02-01T00:00:00Z"}), "tide.nc", "2026-02-01"),
    "current enormous": (lambda site: huge(site, "tide.nc", ("u", "v"), (3, 2, 10**8, 10**8)), "tide.nc"),
    "truth missing": (sections(current={"truth": "hindcast.nc"}), "hindcast.nc", "no such file"),
    # charts
    "coast missing": (gone("coast.geojson"), "coast.geojson", "No such file"),
    "coast a folder": (folder("coast.geojson"), "coast.geojson", "directory"),
    "coast empty": (file("coast.geojson", b""), "coast.geojson", "JSON"),
    "coast half there": (cut("coast.geojson", 0.6), "coast.geojson", "JSON"),
    "coast no GeoJSON": (file("coast.geojson", '{"name": "coast"}'), "coast.geojson", "GeoJSON"),
    "coast nested": (file("coast.geojson", nested(200_000)), "coast.geojson", "JSON"),
    "coast no features": (
        geojson("coast.geojson", type="FeatureCollection", features=[]), "coast.geojson", "features",
    ),
    "coast points": (
        geojson("coast.geojson", type="Point", coordinates=[148.96, -20.34]), "coast.geojson", "Point",
    ),
    "coast crosses itself": (
        coast(SQUARE, STAR), "coast.geojson", "feature 2",
    ),
    "coast ring open": (coast(SQUARE[:-1]), "coast.geojson", "feature 1", "closed"),
    "coast ring of no size": (coast([[148.95, -20.35]] * 4), "coast.geojson", "feature 1"),
    "coast at NaN": (coast([*SQUARE[:2], [NAN, -20.3], *SQUARE[3:]]), "coast.geojson", "feature 1", "finite"),
    "coast off the Earth": (
        coast([[x, y - 90] for x, y in SQUARE]), "coast.geojson", "feature 1", "latitude",
    ),
    "coast in other coordinates": (
        geojson("coast.geojson", type="Polygon", coordinates=[SQUARE], crs={"properties": {"name": "x"}}),
        "coast.geojson", "crs",
    ),
    "closed area missing": (gone("closed.geojson"), "closed.geojson"),
    "closed area around the start": (
        lambda site: site.polygons("closed.geojson", [[x - 0.01, y - 0.01] for x, y in SQUARE]),
        "mission.start", "land",
    ),
    "start on land": (sections(mission={"start": [-400, -400, 5]}), "mission.start", "land"),
    "picture missing": (raster(None), "chart.png"),
    "picture damaged": (raster(png_head(100, 100), "1\n0\n0\n-1\n0\n0\n", crs="EPSG:32755"), "chart.png"),
    "picture a bomb": (raster(png_head(60_000, 60_000), "", crs="EPSG:32755"), "chart.png", "60000 x 60000"),
    "picture of no place": (raster("picture", crs="EPSG:32755"), "chart.png"),
    "reference system unreadable": (raster("picture", "", crs="EPSG:nowhere"), "crs", "EPSG:nowhere"),
    "pixels too small": (sections(chart={"pixel_size": 0.001}), "0.001 m makes"),
    # the sea bed
    "sea bed missing": (gone("bed.nc"), "bed.nc", "No such file"),
    "sea bed a folder": (folder("bed.nc"), "bed.nc", "directory"),
    "sea bed empty": (file("bed.nc", b""), "bed.nc", "NetCDF"),
    "sea bed half there": (cut("bed.nc", 0.5), "bed.nc"),
    "sea bed of other variables": (bed(lambda data: data.drop_vars("depth")), "bed.nc", "sea floor"),
    "sea bed of no such variable": (sections(bathymetry={"variable": "relief"}), "bed.nc", "relief", "depth"),
    "sea bed in seconds": (bed(stated("depth", units="s")), "bed.nc", "depth", "'s'"),
    "sea bed missing everywhere": (bed(everywhere("depth", NAN)), "bed.nc", "depth", "no values"),
    "sea bed both ways": (bed(stated("depth", positive="up")), "bed.nc", "depth", "contradictory"),
    "sea bed against the file": (sections(bathymetry={"positive": "up"}), "bed.nc", "depth", "contradictory"),
    "sea bed upside down": (bed(everywhere("depth", -60.0)), "bed.nc", "depth", "negative"),
    "sea bed in pieces": (bed(moved("latitude", lambda y: y[[0, 2, 1, 3, 4, 5, 6]])), "bed.nc", "latitude"),
    "sea bed nowhere near": (bed(moved("latitude", lambda y: y + 5)), "bed.nc", "beyond"),
    "sea bed above the water": (bed(everywhere("depth", 3.0)), "mission.start", "deep"),
    "sea bed enormous": (lambda site: huge(site, "bed.nc", ("depth",), (10**6, 10**6)), "bed.nc"),
    # jobs
    "jobs missing": (gone("jobs.csv"), "jobs.csv", "No such file"),
    "jobs a folder": (folder("jobs.csv"), "jobs.csv", "directory"),
    "jobs empty": (jobs(""), "jobs.csv", "no rows"),
    "jobs binary": (jobs(bytes(range(256))), "jobs.csv", "text"),
    "jobs without columns": (jobs("a,b\n1,2\n"), "jobs.csv", "columns"),
    "jobs half a place": (jobs(JOBS.replace("east", "oast")), "jobs.csv", "columns"),
    "jobs with a slip": (jobs(JOBS.replace("priority", "prioritty")), "jobs.csv", "'priority'"),
    "jobs not numbers": (jobs(JOBS.replace("1000", "far")), "jobs.csv", "row 2", "east", "far"),
    "jobs NaN": (jobs(JOBS.replace("1000", "nan")), "jobs.csv", "row 2", "east", "nan"),
    "jobs of negative priority": (jobs(JOBS.replace(",2,", ",-2,")), "jobs.csv", "row 2", "priority"),
    "jobs of one name": (jobs(JOBS.replace(",b\n", ",a\n")), "jobs.csv", "'a'"),
    "jobs on land": (jobs(JOBS + "-400,-400,5,1,0,c\n"), "jobs.csv", "'c'", "land"),
    "jobs outside": (jobs(JOBS + "-4000,-400,5,1,0,c\n"), "jobs.csv", "'c'", "outside"),
    "jobs too deep": (jobs(JOBS + "0,1500,200,1,0,c\n"), "jobs.csv", "'c'", "depths"),
    "jobs behind land": (coast(WIDE), "jobs.csv", "no clear line", "'goal'"),
    "jobs an area": (feature("Polygon", [SQUARE]), "jobs.geojson", "Polygon"),
    "jobs above the water": (
        feature("Point", [148.97, -20.35, 30]), "jobs.geojson", "feature 1", "elevation",
    ),
    "jobs a line of one place": (
        feature("LineString", [[148.97, -20.35]]), "jobs.geojson", "feature 1", "2 positions",
    ),
    "jobs with a slip of a property": (
        feature("Point", [148.97, -20.35], durations=1), "jobs.geojson", "feature 1", "'duration'",
    ),
    "jobs beyond all numbers": (feature("Point", [10**400, 0]), "jobs.geojson", "feature 1"),
}  # fmt: skip
