"""What is done to a small site, and words of the one line that must be said of it.

Files of `DAMAGED` are malformed or hostile. Those of `REFUSED` and `NOTED` are sound, and say something else
than a hurried operator meant.
"""

import io
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from typing import Any

import numpy as np
from PIL import Image

from tests.io.small_site import JOBS, SmallSite, X, Y, ring_of, square

# Changes of a site, and of its data sets

gone, folder, cut = (partial(methodcaller, name) for name in ("missing", "folder_instead", "cut"))
sections, put, text = (partial(methodcaller, name) for name in ("set", "put", "text"))
file, raster, huge = (partial(methodcaller, name) for name in ("write", "raster", "huge"))
tide, bed, obstacles = (partial(methodcaller, name) for name in ("tide", "bed", "obstacles"))
scenario, jobs = partial(file, "scenario.yaml"), partial(file, "jobs.csv")
coast = partial(methodcaller, "polygons", "coast.geojson")


def change(*spoils: Callable[[SmallSite], None]) -> Callable[[SmallSite], None]:
    """Several changes, one after the other."""

    def spoil(site: SmallSite) -> None:
        for one in spoils:
            one(site)

    return spoil


def stated(name: str, **attributes: Any) -> Callable:
    return lambda data: data.assign({name: data[name].assign_attrs(attributes)})


def moved(name: str, by: Callable) -> Callable:
    return lambda data: data.assign_coords({name: (name, by(data[name].values), data[name].attrs)})


def changed(by: Callable, *names: str) -> Callable:
    """A change of variables' values."""
    return lambda data: data.assign(
        {name: (data[name].dims, by(data[name].values.copy()), data[name].attrs) for name in names}
    )


def everywhere(name: str, value: float) -> Callable:
    return changed(lambda values: np.full_like(values, value), name)


NAN = float("nan")
#: Half the side of the area and of the files' grids, degrees.
HALF, GRID = 0.0195, 0.03
ISLET = square(X - 0.004, Y, 0.004)
WIDE = ring_of((148.9, -20.3425), (149.0, -20.3425), (149.0, -20.3415), (148.9, -20.3415))
NORTHERN = ring_of((X - 0.03, Y + 0.01), (X + 0.03, Y + 0.01), (X + 0.03, Y + 0.03), (X - 0.03, Y + 0.03))


def place(longitude, latitude, **depth):
    return {"longitude": longitude, "latitude": latitude} | depth


def rows(*lines):
    """A table of jobs."""
    return jobs("\n".join(lines) + "\n")


def picture(rows_, columns=slice(None)):
    """A chart of 60 x 60 pixels, north up: land in some rows and columns."""
    image = np.full((60, 60, 3), (150, 190, 240), np.uint8)
    image[rows_, columns] = 210, 195, 150
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    step = 2 * GRID / 60
    world = f"{step}\n0\n0\n{-step}\n{X - GRID + step / 2}\n{Y + GRID - step / 2}\n"
    return raster(stream.getvalue(), world, crs="EPSG:4326")


def holes(where, value=NAN):
    """Other values at some indices."""

    def spoil(values):
        values[where] = value
        return values

    return spoil


def current(by):
    return tide(changed(by, "uo", "vo"))


def dry_bed(*where):
    """Dry land in some rows and columns of 7 x 7, south and west first."""
    return bed(changed(holes(where, -20.0), "depth"))


def at_hours(*hours):
    """A tide of other hours."""

    def spoil(data):
        return data.isel(time=[0] * len(hours)).assign_coords(
            time=("time", np.asarray(hours, float), data["time"].attrs)
        )

    return tide(spoil)


#: In the North Sea, where either order of the coordinates is a place.
NORWAY = sections(site=place(57.0, 5.0))
#: No files but the jobs, and none at all.
PLAIN = put(chart={"source": "none"}, bathymetry={}, current={"vortices": 0})
BARE = change(PLAIN, sections(mission={"jobs": None}))
NO_BED = sections(bathymetry=None)


def mission(*start_and_goal):
    """Start and goal elsewhere, and no jobs."""
    start, goal = start_and_goal
    return sections(mission={"jobs": None, "start": start, "goal": goal})


YAML = "scenario.yaml"
DAMAGED = {
    # the text of the scenario
    "scenario missing": (gone(YAML), YAML, "No such file"),
    "scenario a folder": (folder(YAML), YAML, "directory"),
    "scenario empty": (scenario(""), YAML, "mapping"),
    "scenario binary": (scenario(bytes(range(256))), YAML, "not a text file"),
    "scenario huge": (scenario("#" * 1_100_000), YAML, "larger"),
    # its fields
    "speed NaN": (sections(vehicle={"speed": NAN}), "scenario.yaml:", "vehicle.speed", "nan"),
    "departure at the beginning of time": (sections(site={"departure": "0001-01-01T00:00:00+14:00"}),
                                           "scenario.yaml:"),
    # currents
    "current missing": (gone("tide.nc"), "tide.nc", "no such file"),
    "current half there": (cut("tide.nc", 0.5), "tide.nc", "NetCDF"),
    "current none of a pattern": (sections(current={"files": "*.grb"}), "*.grb", "no such file"),
    "current ends early": (sections(mission={"time_available": 86_400}), "tide.nc", "2026-03-02"),
    "current begins later": (sections(site={"departure": "2026-02-01T00:00:00Z"}), "tide.nc", "2026-02-01"),
    "current enormous": (huge("tide.nc", ("u", "v"), (3, 2, 10**8, 10**8)), "tide.nc"),
    # charts
    "coast missing": (gone("coast.geojson"), "coast.geojson", "No such file"),
    "closed area around the start": (
        lambda site: site.polygons("closed.geojson", square(148.94, -20.36, 0.01)), "mission.start", "land"),
    "start on land": (sections(mission={"start": [-400, -400, 5]}), "mission.start", "land"),
    # the sea bed
    "sea bed missing": (gone("bed.nc"), "bed.nc", "No such file"),
    "sea bed above the water": (bed(everywhere("depth", 3.0)), "mission.start", "deep"),
    "sea bed enormous": (huge("bed.nc", ("depth",), (10**6, 10**6)), "bed.nc"),
    # jobs
    "jobs on land": (jobs(JOBS + "-400,-400,5,1,0,c\n"), "jobs.csv", "'c'", "land"),
    "jobs behind land": (coast(WIDE), "jobs.csv", "no clear line", "'goal'"),
}  # fmt: skip

REFUSED = {
    # the scenario: numbers
    "hours for seconds": (sections(mission={"time_available": 3}), "time_available", "is this hours?"),
    "minutes for seconds": (sections(mission={"time_available": 120}),
                            "time_available", "straight line", "surge_max"),
    "time of day for seconds": (text("available: 3600", "available: 1:00"), "time_available", "base 60"),
    "truth for a number": (text("available: 3600", "available: yes"), "time_available", "true or false"),
    "knots with their unit": (sections(vehicle={"speed": "4 kn"}), "vehicle.speed", "4 kn"),
    "depth upwards": (sections(mission={"start": [-1500, -1500, -5]}), "mission.start", "depths"),
    # the scenario: where and when
    "departure a number": (sections(site={"departure": 20260301}),
                           "site.departure", "a date such as", "20260301"),
    "site swapped": (sections(site=place(Y, X)), "site.latitude", "swapped"),
    "start swapped": (sections(mission={"start": place(Y, X, depth=5)}), "mission.start", "swapped"),
    "start swapped where both are places": (
        change(BARE, NORWAY, sections(mission={"start": place(5.0, 57.0)})),
        "mission.start", "swapped it would lie within"),
    "corners swapped": (sections(area={"lower": place(Y - HALF, X - HALF, depth=0),
                                       "upper": place(Y + HALF, X + HALF, depth=30)}), "area", "swapped"),
    # jobs
    "jobs swapped where both are places": (
        change(PLAIN, NORWAY, rows("lon,lat,depth", "5.001,57.001,5", "5.002,57.002,5")),
        "jobs.csv", "longitude and latitude seem swapped"),
    "jobs of another place": (rows("lon,lat,depth", "140.1,-20,5", "140.2,-20,5"),
                              "jobs.csv", "km", "longitude 140.1"),
    "jobs in metres of a projection": (rows("north,east,depth", "7750000,495000,5", "7750100,495100,5"),
                                       "jobs.csv", "UTM"),
    "north and east swapped": (
        change(PLAIN, sections(area={"upper": [2000, 5000, 30]}),
               rows("north,east,depth", "4000,100,5", "4500,200,5")),
        "jobs.csv", "north and east seem swapped"),
    "western jobs": (rows("lon,lat,depth", f"-{X},{Y},5", f"-{X},{Y - 0.01},5"),
                     "jobs.csv", "km", "longitude -148.96"),
    # charts
    "chart upside down": (change(picture(slice(40, 60)), dry_bed(slice(4, 7))), "mission.start", "land"),
    # sea bed and currents
    "sea bed above the water": (bed(everywhere("depth", 0.0)), "bed.nc", "below the sea surface", "positive"),
    "an hour without values": (current(holes(1)), "tide.nc", "2026-03-01T01:00:00Z", "100%"),
    "most of an hour without values": (current(holes(np.s_[1, :, 1:])), "tide.nc", "T01:00:00Z", "missing"),
    "a fill value as it is": (current(holes(np.s_[:, :, 3, 3], -9999.0)), "tide.nc", "_FillValue"),
    "a forecast of another place": (
        change(sections(current={"outside": "clamp"}), tide(moved("longitude", lambda x: x + 5))),
        "tide.nc", "100% of the box"),
    "a forecast that ends at sea": (tide(lambda data: data.isel(longitude=slice(0, 5))),
                                    "tide.nc", "not covered", "east"),
    "a forecast swapped": (
        change(PLAIN, NORWAY, put(current={"source": "file", "files": "tide.nc"}),
               mission([-500, -500, 5], [500, 500, 5]),
               sections(area={"lower": [-1000, -1000, 0], "upper": [1000, 1000, 30]}),
               tide(lambda data: moved("longitude", lambda x: x - X + 5.0)(
                   moved("latitude", lambda y: y - Y + 57.0)(data)))),
        "tide.nc", "swapped"),
}  # fmt: skip

NOTED = {
    # the scenario
    "time short of still water": (sections(mission={"time_available": 1200}),
                                  "time_available", "still water", "1,265 s"),
    "pitch in tenths of a degree": (sections(vehicle={"pitch_max": 0.02}),
                                    "vehicle.pitch_max", "1.1 degrees", "20 m in a kilometre"),
    "deeper than it can dive on the way": (
        sections(vehicle={"dive_rate_max": 0.001}),
        "b lies 5 m below", "vehicle.dive_rate_max allows 0.02, and a path must be 12,500 m long"),
    "dives faster than it is": (sections(vehicle={"dive_rate_max": 9}),
                                "vehicle.dive_rate_max", "nothing is limited"),
    "vehicle faster than it may": (sections(vehicle={"speed": 9}), "vehicle.speed", "surge_max"),
    "fringe of a picture": (change(picture(slice(0, 6)), dry_bed(6), sections(chart={"fringe": 50})),
                            "chart.fringe", "has no effect"),
    "reference system of polygons": (sections(chart={"crs": "EPSG:32755"}), "chart.crs", "has no effect"),
    "vortices beside a file": (sections(current={"peak_speed": 2.0}), "current.peak_speed", "has no effect"),
    "waypoints beside jobs": (sections(mission={"waypoints": 12}),
                              "mission.waypoints", "has no effect", "jobs.csv"),
    "direction of no sea bed": (change(NO_BED, sections(bathymetry={"positive": "up"})),
                                "bathymetry.positive", "has no effect"),
    "departure without a zone": (sections(site={"departure": "2026-03-01T00:00:00"}),
                                 "site.departure", "UTC", "zone"),
    "departure a day": (sections(site={"departure": "2026-03-01"}), "site.departure", "UTC", "00:00:00Z"),
    "area of another place": (
        change(BARE, mission(None, None), sections(area={"lower": place(140.0, -20.0, depth=0),
                                                         "upper": place(140.1, -19.9, depth=30)})),
        "area", "km from the site"),
    "shipped chart elsewhere": (
        change(BARE, NORWAY, sections(chart=None), mission(None, None),
               sections(area={"lower": [1000, 1000, 0], "upper": [3000, 3000, 30]},
                        mission={"waypoints": 4})),
        "chart", "Whitsunday", "km from the site"),
    "picture of no size": (
        change(picture(slice(0, 6)), put(chart={"source": "image", "image": "chart.png"}), NO_BED,
               sections(area={"lower": [0, 0, 0], "upper": [400, 400, 30]}, current={"outside": "clamp"}),
               mission([50, 50, 5], [300, 300, 5])),
        "chart.image", "pixel_size", "10 m"),
    # jobs
    "milliseconds for seconds": (rows("north,east,depth,duration,name", "-500,1000,5,60000,a"),
                                 "'a'", "60000 s", "seconds"),
    "no priorities": (rows("north,east,depth,priority", "-500,1000,5,0"),
                      "jobs.csv", "no job has a priority"),
    "a job twice": (rows("north,east,depth,name", "-500,1000,5,a", "-500,1000,5,b"),
                    "'a' and 'b'", "same place"),
    # known obstacles and charts
    "obstacles of another place": (obstacles([X - 1, Y], radius=50), "obstacles.geojson", "none of its"),
    "a wreck on land": (change(coast(ISLET), obstacles([X - 0.002, Y + 0.002], radius=20, name="wreck")),
                        "obstacles.geojson", "'wreck' lies on land", "no path is changed"),
    "land in another place": (coast([[x - 5, y] for x, y in ISLET]),
                              "coast.geojson", "none of its polygons", "143"),
    "land swapped": (change(BARE, NORWAY, put(chart={"source": "polygons", "file": "coast.geojson"}),
                            coast(square(4.98, 56.98, 0.01))), "coast.geojson", "swapped"),
    "closed area in another place": (lambda site: site.polygons("closed.geojson", square(X, Y - 3, 0.004)),
                                     "closed.geojson", "closed area", "latitudes -23"),
    "chart upside down, start in water": (
        change(picture(slice(40, 60)), dry_bed(slice(4, 7)), mission([0, -1500, 5], [300, 1500, 5])),
        "chart.png", "contradict each other", "upside down"),
    "chart mirrored": (
        change(picture(slice(None), slice(40, 60)), dry_bed(slice(None), slice(0, 3)),
               mission([-1500, 0, 5], [1500, 300, 5])),
        "chart.png", "mirrored"),
    "chart against the current": (change(coast(NORTHERN), mission([-1500, -1500, 5], [0, 1500, 5])),
                                  "coast.geojson", "contradict each other"),
    "open water against the current": (
        change(put(chart={"source": "none"}), NO_BED, current(holes(np.s_[..., 3:, :]))),
        "open water", "tide.nc", "contradict each other"),
    "picture of one colour": (change(picture(slice(0, 0)), sections(mission={"jobs": None})),
                              "chart.png", "no land"),
    # sea bed and currents
    "sea bed with holes": (
        change(bed(changed(holes(np.s_[4, 2]), "depth")), mission([-1500, -1500, 5], [-1000, 1500, 5])),
        "bed.nc", "no depth"),
    "sea bed of no unit": (bed(stated("depth", units="")), "bed.nc", "units are not given: metres"),
    "an hour left out": (at_hours(0, 3, 4, 5, 6, 7), "tide.nc", "T00:00:00Z", "usual step"),
    "a hole for an hour": (current(holes(np.s_[1, :, 3, 3])),
                           "tide.nc", "at some times only", "148.96", "T01:00:00Z"),
    "a hole in the upper water": (current(holes(np.s_[:, 0, 3:5, 3])), "tide.nc", "at 0 m depth", "148.96"),
    "centimetres for metres": (current(lambda speed: 30.0 * speed), "tide.nc", "9.5 m/s", "units"),
    "a current of nothing": (current(lambda speed: 0.0 * speed), "tide.nc", "0 everywhere"),
    "a forecast of last month": (
        change(sections(current={"outside": "clamp"}), tide(stated("time", units="hours since 2026-02-01"))),
        "tide.nc", "none of it is covered"),
}  # fmt: skip
