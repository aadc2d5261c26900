"""Inputs that a hurried operator writes: each is refused for its cause, or read with a line that tells it.

Beside `bad_input`, whose files are damaged or hostile, these are all sound files that say something else than
is meant.
"""

import io
import json

import numpy as np
from PIL import Image

from tests.io.small_site import CENTRE
from tests.io.spoiling import bed, coast, everywhere, file, jobs, moved, ring_of, sections, stated, tide

REFUSED, WARNED = "refused", "warned"
NAN = float("nan")
X, Y = CENTRE
#: Half the side of the area and of the files' grids, degrees.
HALF, GRID = 0.0195, 0.03
WATER, LAND = (150, 190, 240), (210, 195, 150)
NORTHERN_LAND = ring_of(
    (X - 0.03, Y + 0.01), (X + 0.03, Y + 0.01), (X + 0.03, Y + 0.03), (X - 0.03, Y + 0.03)
)
ISLET = ring_of((X - 0.004, Y), (X, Y), (X, Y + 0.004), (X - 0.004, Y + 0.004))


def change(*spoils):
    """Several changes, one after the other."""

    def spoil(site):
        for one in spoils:
            one(site)

    return spoil


def set_text(old, new):
    """A change of the scenario's text, for what YAML would write in another way."""

    def spoil(site):
        text = (site.folder / "scenario.yaml").read_text()
        assert old in text
        site.write("scenario.yaml", text.replace(old, new))

    return spoil


def rows(heading, *lines):
    return jobs("\n".join([heading, *lines]) + "\n")


def features(*places, **properties):
    """Jobs by GeoJSON, a point each."""
    found = [
        {"type": "Feature", "properties": properties, "geometry": {"type": "Point", "coordinates": place}}
        for place in places
    ]
    text = json.dumps({"type": "FeatureCollection", "features": found})
    return change(sections(mission={"jobs": "jobs.geojson"}), file("jobs.geojson", text))


def obstacles(*places, **properties):
    """Known obstacles by GeoJSON, a point each."""
    found = [
        {"type": "Feature", "properties": properties, "geometry": {"type": "Point", "coordinates": place}}
        for place in places
    ]
    text = json.dumps({"type": "FeatureCollection", "features": found})
    return change(sections(obstacles={"file": "obstacles.geojson"}), file("obstacles.geojson", text))


def picture(dry, land=LAND):
    """A chart of 60 x 60 pixels, north up: coast where `dry` [60, 60] is."""
    image = np.empty((60, 60, 3), np.uint8)
    image[:] = WATER
    image[dry] = land
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    step = 2 * GRID / 60
    world = f"{step}\n0\n0\n{-step}\n{X - GRID + step / 2}\n{Y + GRID - step / 2}\n"
    return lambda site: site.raster(stream.getvalue(), world, crs="EPSG:4326")


def part(rows_, columns=slice(None)):
    dry = np.zeros((60, 60), bool)
    dry[rows_, columns] = True
    return dry


def bed_of(dry):
    """A sea bed with dry land where `dry` [7, 7], south and west first, is."""

    def spoil(data):
        depth = np.where(dry, -20.0, 60.0)
        return data.assign(depth=(data["depth"].dims, depth, data["depth"].attrs))

    return bed(spoil)


def half(rows_, columns=slice(None)):
    dry = np.zeros((7, 7), bool)
    dry[rows_, columns] = True
    return dry


def holes(where, value=NAN):
    """A tide whose values at some indices are others."""

    def spoil(data):
        out = data.copy(deep=True)
        for name in ("uo", "vo"):
            out[name].values[where] = value
        return out

    return tide(spoil)


def longer(hours, missing=()):
    """A tide of more hours, some of which are left out, or without values."""

    def spoil(data):
        kept = [hour for hour in hours if hour not in missing]
        fields = {
            name: (data[name].dims, np.repeat(data[name].values[:1], len(kept), axis=0), data[name].attrs)
            for name in ("uo", "vo")
        }
        times = ("time", np.asarray(kept, float), data["time"].attrs)
        return data.drop_vars(["uo", "vo", "time"]).assign(fields).assign_coords(time=times)

    return tide(spoil)


def scaled(by):
    def spoil(data):
        fields = {name: (data[name].dims, by * data[name].values, data[name].attrs) for name in ("uo", "vo")}
        return data.assign(fields)

    return tide(spoil)


def norway(site):
    """The site in the North Sea, where either order of its coordinates is a place."""
    site.set(site={"longitude": Y_NORWAY, "latitude": X_NORWAY})


X_NORWAY, Y_NORWAY = 5.0, 57.0


def plain(site):
    """The same with no files but the jobs."""
    for section in ("chart", "bathymetry", "current"):
        site.plain[section] = {}
    site.plain["chart"] = {"source": "none"}
    site.plain["current"] = {"vortices": 0}
    site.save()


#: Name to what is done, how it ends, and words of the one line that says it.
VARIANTS = {
    # the scenario: numbers
    "hours for seconds": (
        sections(mission={"time_available": 3}),
        REFUSED,
        "time_available",
        "is this hours?",
    ),
    "minutes for seconds": (
        sections(mission={"time_available": 120}),
        REFUSED,
        "time_available",
        "straight way",
        "surge_max",
    ),
    "time short of still water": (
        sections(mission={"time_available": 1200}),
        WARNED,
        "time_available",
        "still water",
        "1,697 s",
    ),
    "time of day for seconds": (
        set_text("time_available: 3600", "time_available: 1:00"),
        REFUSED,
        "time_available",
        "base 60",
    ),
    "octal number": (
        set_text("time_available: 3600", "time_available: 07020"),
        REFUSED,
        "time_available",
        "octal",
    ),
    "truth for a number": (
        set_text("time_available: 3600", "time_available: yes"),
        REFUSED,
        "time_available",
        "true or false",
    ),
    "truth in a list": (
        sections(mission={"start": [True, -1500, 5]}),
        REFUSED,
        "mission.start",
        "true or false",
    ),
    "truth two sections down": (
        sections(simulation={"obstacles": {"speed": True}}),
        REFUSED,
        "simulation.obstacles",
        "true or false",
    ),
    "range the wrong way": (
        sections(simulation={"obstacles": {"radius": [60, 20]}}),
        REFUSED,
        "radius",
        "least and then the greatest",
    ),
    "durations the wrong way": (
        sections(mission={"duration": [300, 30]}),
        REFUSED,
        "mission.duration",
        "least and then the greatest",
    ),
    "priorities the wrong way": (
        sections(mission={"priority": [5, 1]}),
        REFUSED,
        "mission.priority",
        "least and then the greatest",
    ),
    "pitch in tenths of a degree": (
        sections(vehicle={"pitch_max": 0.02}),
        WARNED,
        "vehicle.pitch_max",
        "1.1 degrees",
        "20 m in a kilometre",
    ),
    "deeper than it can dive on the way": (
        sections(vehicle={"dive_rate_max": 0.001}),
        WARNED,
        "b lies 5 m below",
        "vehicle.dive_rate_max allows 0, and a path must be 12,500 m long",
    ),
    "dives faster than it is": (
        sections(vehicle={"dive_rate_max": 9}),
        WARNED,
        "vehicle.dive_rate_max",
        "nothing is limited",
    ),
    "vehicle faster than it may": (sections(vehicle={"speed": 9}), WARNED, "vehicle.speed", "surge_max"),
    "knots with their unit": (sections(vehicle={"speed": "4 kn"}), REFUSED, "vehicle.speed", "4 kn"),
    "depth upwards": (sections(mission={"start": [-1500, -1500, -5]}), REFUSED, "mission.start", "depths"),
    # the scenario: fields that have no effect
    "fringe of a picture": (
        change(picture(part(slice(0, 6))), bed_of(half(6)), sections(chart={"fringe": 50})),
        WARNED,
        "chart.fringe",
        "has no effect",
    ),
    "reference system of polygons": (
        sections(chart={"crs": "EPSG:32755"}),
        WARNED,
        "chart.crs",
        "has no effect",
    ),
    "vortices beside a file": (
        sections(current={"peak_speed": 2.0}),
        WARNED,
        "current.peak_speed",
        "has no effect",
    ),
    "waypoints beside jobs": (
        sections(mission={"waypoints": 12}),
        WARNED,
        "mission.waypoints",
        "has no effect",
        "jobs.csv",
    ),
    "direction of no sea bed": (
        change(lambda site: site.plain.pop("bathymetry"), sections(bathymetry={"positive": "up"})),
        WARNED,
        "bathymetry.positive",
        "has no effect",
    ),
    # the scenario: where and when
    "departure without a zone": (
        sections(site={"departure": "2026-03-01T00:00:00"}),
        WARNED,
        "site.departure",
        "UTC",
        "zone",
    ),
    "departure a day": (
        sections(site={"departure": "2026-03-01"}),
        WARNED,
        "site.departure",
        "UTC",
        "00:00:00Z",
    ),
    "departure a number": (
        sections(site={"departure": 20260301}),
        REFUSED,
        "site.departure",
        "a date such as",
        "20260301",
    ),
    "site swapped": (
        sections(site={"longitude": Y, "latitude": X}),
        REFUSED,
        "site.latitude",
        "swapped",
    ),
    "start swapped": (
        sections(mission={"start": {"longitude": Y, "latitude": X, "depth": 5}}),
        REFUSED,
        "mission.start",
        "swapped",
    ),
    "start swapped where both are places": (
        change(
            plain, norway, sections(mission={"jobs": None, "start": {"longitude": 5.0, "latitude": 57.0}})
        ),
        REFUSED,
        "mission.start",
        "swapped it would lie within",
    ),
    "corners swapped": (
        sections(
            area={
                "lower": {"longitude": Y - HALF, "latitude": X - HALF, "depth": 0},
                "upper": {"longitude": Y + HALF, "latitude": X + HALF, "depth": 30},
            }
        ),
        REFUSED,
        "area",
        "swapped",
    ),
    "area of another place": (
        change(
            plain,
            sections(
                mission={"jobs": None, "start": None, "goal": None},
                area={
                    "lower": {"longitude": 140.0, "latitude": -20.0, "depth": 0},
                    "upper": {"longitude": 140.1, "latitude": -19.9, "depth": 30},
                },
            ),
        ),
        WARNED,
        "area",
        "km from the site",
    ),
    "shipped chart elsewhere": (
        change(
            plain,
            norway,
            lambda site: site.plain.pop("chart"),
            lambda site: site.save(),
            sections(
                area={"lower": [1000, 1000, 0], "upper": [3000, 3000, 30]},
                mission={"jobs": None, "start": None, "goal": None, "waypoints": 4},
            ),
        ),
        WARNED,
        "chart",
        "Whitsunday",
        "km from the site",
    ),
    "picture of no size": (
        change(
            picture(part(slice(0, 6))),
            lambda site: site.plain.update(chart={"source": "image", "image": "chart.png"}),
            lambda site: site.plain.pop("bathymetry"),
            sections(
                area={"lower": [0, 0, 0], "upper": [400, 400, 30]},
                current={"outside": "clamp"},
                mission={"jobs": None, "start": [50, 50, 5], "goal": [300, 300, 5]},
            ),
        ),
        WARNED,
        "chart.image",
        "pixel_size",
        "10 m",
    ),
    # jobs: headings
    "dwell for duration": (
        rows("north,east,depth,priority,dwell", "-500,1000,5,2,60"),
        WARNED,
        "jobs.csv",
        "'dwell'",
        "'duration'",
    ),
    "time for duration": (
        rows("north,east,depth,priority,time", "-500,1000,5,2,60"),
        WARNED,
        "jobs.csv",
        "'time'",
        "'duration'",
    ),
    "weight for priority": (
        rows("north,east,depth,weight", "-500,1000,5,2"),
        WARNED,
        "jobs.csv",
        "'weight'",
        "'priority'",
    ),
    "prio for priority": (
        rows("north,east,depth,prio", "-500,1000,5,2"),
        REFUSED,
        "jobs.csv",
        "'prio'",
        "'priority'",
    ),
    "a unit in a heading": (
        rows("north,east,depth [m],priority", "-500,1000,5,2"),
        REFUSED,
        "jobs.csv",
        "'depth [m]'",
        "'depth'",
    ),
    "minutes in a heading": (
        rows("north,east,depth,duration_min", "-500,1000,5,2"),
        REFUSED,
        "jobs.csv",
        "'duration_min'",
        "(s)",
    ),
    "z for depth": (rows("north,east,z", "-500,1000,5"), WARNED, "jobs.csv", "'z'", "'depth'"),
    "altitude for depth": (
        rows("north,east,altitude", "-500,1000,-5"),
        WARNED,
        "jobs.csv",
        "'altitude'",
        "positive down",
    ),
    "id for name": (rows("north,east,depth,id", "-500,1000,5,7"), WARNED, "jobs.csv", "'id'", "'name'"),
    "track for line": (
        rows("north,east,depth,transect", "-500,1000,5,a", "-900,1000,5,a"),
        WARNED,
        "jobs.csv",
        "'line'",
    ),
    "a wish of no job": (
        rows("north,east,depth,deadline", "-500,1000,5,600"),
        WARNED,
        "jobs.csv",
        "'deadline'",
        "ignored",
    ),
    "easting and northing": (
        rows("easting,northing,depth", "495000,7750000,5"),
        REFUSED,
        "jobs.csv",
        "columns",
    ),
    "x and y": (rows("x,y,depth", "-500,1000,5"), WARNED, "jobs.csv", "x and y", "north and east"),
    "degrees as x and y": (
        rows("x,y,depth", f"{X},{Y},5", f"{X + 0.005},{Y - 0.01},5"),
        REFUSED,
        "jobs.csv",
        "longitude and latitude",
    ),
    "degrees as north and east": (
        rows("north,east,depth", f"{Y - 0.01},{X},5"),
        REFUSED,
        "jobs.csv",
        "latitude and longitude",
    ),
    "no headings": (rows("-500,1000,5", "1000,-800,5"), REFUSED, "jobs.csv", "columns"),
    "dwell of a feature": (
        features([X + 0.01, Y - 0.01], dwell=60),
        WARNED,
        "jobs.geojson",
        "'dwell'",
        "'duration'",
    ),
    "weight of many features": (
        features([X + 0.01, Y - 0.01], [X + 0.01, Y], weight=3),
        WARNED,
        "feature 1",
        "'weight'",
        "'priority'",
    ),
    # jobs: places
    "jobs swapped": (
        rows("lon,lat,depth", f"{Y},{X},5", f"{Y - 0.01},{X},5"),
        REFUSED,
        "row 2",
        "swapped",
        "all 2 places",
    ),
    "features swapped": (
        features([Y, X], [Y - 0.01, X], [Y, X + 0.01]),
        REFUSED,
        "feature 1",
        "swapped",
        "all 3 places",
    ),
    "one job swapped": (
        rows("lon,lat,depth", f"{X},{Y - 0.01},5", f"{Y - 0.01},{X},5"),
        REFUSED,
        "row 3",
        "seem swapped",
    ),
    "jobs swapped where both are places": (
        change(plain, norway, rows("lon,lat,depth", "5.001,57.001,5", "5.002,57.002,5")),
        REFUSED,
        "jobs.csv",
        "longitude and latitude seem swapped",
    ),
    "jobs of another place": (
        rows("lon,lat,depth", "140.1,-20,5", "140.2,-20,5"),
        REFUSED,
        "jobs.csv",
        "km",
        "longitude 140.1",
    ),
    "jobs in metres of a projection": (
        rows("north,east,depth", "7750000,495000,5", "7750100,495100,5"),
        REFUSED,
        "jobs.csv",
        "UTM",
    ),
    "north and east swapped": (
        change(
            plain,
            sections(area={"upper": [2000, 5000, 30]}),
            rows("north,east,depth", "4000,100,5", "4500,200,5"),
        ),
        REFUSED,
        "jobs.csv",
        "north and east seem swapped",
    ),
    "a decimal comma": (rows("north,east,depth", "-500,5,1000,5"), REFUSED, "row 2", "4 cells under 3"),
    "jobs in degrees and minutes": (
        rows("lon,lat,depth", "148 57.6 E,20 20.4 S,5"),
        REFUSED,
        "row 2",
        "finite number",
    ),
    # jobs: what they say
    "milliseconds for seconds": (
        rows("north,east,depth,duration,name", "-500,1000,5,60000,a"),
        WARNED,
        "'a'",
        "60000 s",
        "seconds",
    ),
    "no priorities": (
        rows("north,east,depth,priority", "-500,1000,5,0"),
        WARNED,
        "jobs.csv",
        "no job has a priority",
    ),
    "a job twice": (
        rows("north,east,depth,name", "-500,1000,5,a", "-500,1000,5,b"),
        WARNED,
        "'a' and 'b'",
        "same place",
    ),
    "two jobs of one name": (
        rows("north,east,depth,name", "-500,1000,5,a", "900,1000,5,a"),
        REFUSED,
        "two jobs are named 'a'",
    ),
    "western jobs": (
        rows("lon,lat,depth", f"-{X},{Y},5", f"-{X},{Y - 0.01},5"),
        REFUSED,
        "jobs.csv",
        "km",
        "longitude -148.96",
    ),
    # known obstacles
    "obstacles of another place": (
        obstacles([X - 1, Y], radius=50),
        WARNED,
        "obstacles.geojson",
        "none of its",
    ),
    "obstacles swapped": (
        obstacles([Y, X], [Y, X + 1], radius=50),
        REFUSED,
        "feature 1",
        "swapped",
        "all 2 places",
    ),
    "a wreck on land": (
        change(coast(ISLET), obstacles([X - 0.002, Y + 0.002], radius=20, name="wreck")),
        WARNED,
        "obstacles.geojson",
        "'wreck' lies on land",
        "no path is changed",
    ),
    "a diameter for a radius": (
        obstacles([X, Y], diameter=50),
        REFUSED,
        "feature 1",
        "diameter is unknown",
    ),
    "a slip of an obstacle": (obstacles([X, Y], radius=5, depthmax=9), REFUSED, "depthmax", "'depth_max'"),
    # charts
    "land in another place": (
        coast([[x - 5, y] for x, y in ISLET]),
        WARNED,
        "coast.geojson",
        "none of its polygons",
        "143",
    ),
    "land swapped": (
        change(
            plain,
            norway,
            sections(mission={"jobs": None}, chart={"source": "polygons", "file": "coast.geojson"}),
            coast(ring_of((4.98, 56.98), (4.99, 56.98), (4.99, 56.99), (4.98, 56.99))),
        ),
        WARNED,
        "coast.geojson",
        "swapped",
    ),
    "land in metres": (
        coast([[495000.0, 7750000.0], [496000.0, 7750000.0], [496000.0, 7751000.0], [495000.0, 7750000.0]]),
        REFUSED,
        "coast.geojson",
        "projection",
    ),
    "closed area in another place": (
        lambda site: site.polygons("closed.geojson", [[x, y - 3] for x, y in ISLET]),
        WARNED,
        "closed.geojson",
        "closed area",
        "latitudes -23",
    ),
    "chart upside down": (
        change(picture(part(slice(40, 60))), bed_of(half(slice(4, 7)))),
        REFUSED,
        "mission.start",
        "land",
    ),
    "chart upside down, start in water": (
        change(
            picture(part(slice(40, 60))),
            bed_of(half(slice(4, 7))),
            sections(mission={"start": [0, -1500, 5], "goal": [300, 1500, 5], "jobs": None}),
        ),
        WARNED,
        "chart.png",
        "contradict each other",
        "upside down",
    ),
    "chart mirrored": (
        change(
            picture(part(slice(None), slice(40, 60))),
            bed_of(half(slice(None), slice(0, 3))),
            sections(mission={"start": [-1500, 0, 5], "goal": [1500, 300, 5], "jobs": None}),
        ),
        WARNED,
        "chart.png",
        "mirrored",
    ),
    "chart against the current": (
        change(
            coast(NORTHERN_LAND),
            sections(mission={"start": [-1500, -1500, 5], "goal": [0, 1500, 5], "jobs": None}),
        ),
        WARNED,
        "coast.geojson",
        "contradict each other",
    ),
    "open water against the current": (
        change(
            lambda site: site.plain.update(chart={"source": "none"}),
            lambda site: site.plain.pop("bathymetry"),
            lambda site: site.save(),
            holes(np.s_[..., 3:, :]),
        ),
        WARNED,
        "open water",
        "tide.nc",
        "contradict each other",
    ),
    "picture of one colour": (
        change(picture(part(slice(0, 0))), sections(mission={"jobs": None})),
        WARNED,
        "chart.png",
        "no land",
    ),
    "picture of another place": (
        change(
            picture(part(slice(0, 6))), lambda site: site.write("chart.pgw", "0.001\n0\n0\n-0.001\n5\n5\n")
        ),
        REFUSED,
        "chart.png",
        "beyond the picture",
    ),
    "picture placed by swapped numbers": (
        change(
            picture(part(slice(0, 6))),
            lambda site: site.write("chart.pgw", f"0.001\n0\n0\n-0.001\n{Y - 0.03}\n{X + 0.03}\n"),
        ),
        REFUSED,
        "chart.png",
        "beyond the picture",
    ),
    # the sea bed
    "sea bed above the water": (
        bed(everywhere("depth", 0.0)),
        REFUSED,
        "bed.nc",
        "below the sea surface",
        "positive",
    ),
    "sea bed with holes": (
        change(
            bed(lambda data: data.where((data["longitude"] != X - 0.01) | (data["latitude"] != Y + 0.01))),
            sections(mission={"jobs": None, "goal": [-1000, 1500, 5]}),
        ),
        WARNED,
        "bed.nc",
        "no depth",
    ),
    "sea bed of no unit": (bed(stated("depth", units="")), WARNED, "bed.nc", "units are not given: metres"),
    "sea bed of two places": (
        bed(moved("latitude", lambda y: y + 0.02)),
        REFUSED,
        "bed.nc",
        "beyond the data",
    ),
    # currents
    "an hour without values": (holes(np.s_[1]), REFUSED, "tide.nc", "2026-03-01T01:00:00Z", "100%"),
    "most of an hour without values": (holes(np.s_[1, :, 1:]), REFUSED, "tide.nc", "T01:00:00Z", "missing"),
    "an hour left out": (longer(range(8), missing=(1, 2)), WARNED, "tide.nc", "T00:00:00Z", "usual step"),
    "a hole for an hour": (
        holes(np.s_[1, :, 3, 3]),
        WARNED,
        "tide.nc",
        "at some times only",
        "148.96",
        "T01:00:00Z",
    ),
    "a hole in the upper water": (holes(np.s_[:, 0, 3:5, 3]), WARNED, "tide.nc", "at 0 m depth", "148.96"),
    "centimetres for metres": (scaled(30.0), WARNED, "tide.nc", "9.5 m/s", "units"),
    "a current of nothing": (scaled(0.0), WARNED, "tide.nc", "0 everywhere"),
    "a fill value as it is": (holes(np.s_[:, :, 3, 3], -9999.0), REFUSED, "tide.nc", "_FillValue"),
    "a forecast of last month": (
        change(sections(current={"outside": "clamp"}), tide(stated("time", units="hours since 2026-02-01"))),
        WARNED,
        "tide.nc",
        "none of it is covered",
    ),
    "a forecast of another place": (
        change(sections(current={"outside": "clamp"}), tide(moved("longitude", lambda x: x + 5))),
        REFUSED,
        "tide.nc",
        "100% of the box",
    ),
    "a forecast that ends at sea": (
        tide(lambda data: data.isel(longitude=slice(0, 5))),
        REFUSED,
        "tide.nc",
        "not covered",
        "east",
    ),
    "a forecast swapped": (
        change(
            plain,
            norway,
            lambda site: site.plain.update(current={"source": "file", "files": "tide.nc"}),
            sections(
                mission={"jobs": None, "start": [-500, -500, 5], "goal": [500, 500, 5]},
                area={"lower": [-1000, -1000, 0], "upper": [1000, 1000, 30]},
            ),
            tide(
                lambda data: data.assign_coords(
                    longitude=("longitude", data["longitude"].values - X + X_NORWAY, data["longitude"].attrs),
                    latitude=("latitude", data["latitude"].values - Y + Y_NORWAY, data["latitude"].attrs),
                )
            ),
        ),
        REFUSED,
        "tide.nc",
        "swapped",
    ),
}
