"""Make `auvplan/data/whitsunday_coast.geojson`: OpenStreetMap land polygons clipped to one site.

Needs the extra `tools` (roaring-landmask ships the polygons; loading them takes 1.4 GB of memory and some
seconds): ``pip install -e '.[tools]' && python tools/make_whitsunday_coast.py``. The result is committed, so
that nothing but this script depends on the package.
"""

import json
from pathlib import Path

import numpy as np
import shapely
from roaring_landmask import LandmaskProvider, Shapes

from auvplan.ocean.whitsunday import CENTRE

#: Half-width of the clip, m: a little more than the 10 km that are rendered.
HALF_WIDTH = 5600.0
#: Vertices that move the outline by less than this are dropped, m.
TOLERANCE = 5.0
METRES_PER_DEGREE = 111_000.0
TARGET = Path(__file__).parent.parent / "auvplan" / "data" / "whitsunday_coast.geojson"


def main() -> None:
    """Clip, simplify, write."""
    longitude, latitude = CENTRE
    wide = HALF_WIDTH / (METRES_PER_DEGREE * np.cos(np.radians(latitude)))
    high = HALF_WIDTH / METRES_PER_DEGREE
    box = shapely.box(longitude - wide, latitude - high, longitude + wide, latitude + high)
    world = shapely.from_wkb(Shapes.wkb(LandmaskProvider.Osm))
    parts = shapely.get_parts(world)
    near = parts[shapely.intersects(shapely.envelope(parts), box)]
    land = shapely.union_all(shapely.intersection(shapely.make_valid(near), box))
    land = shapely.simplify(land, TOLERANCE / METRES_PER_DEGREE, preserve_topology=True)
    polygons = [part for part in shapely.get_parts(land) if part.geom_type == "Polygon"]
    features = [
        {"type": "Feature", "properties": {}, "geometry": json.loads(shapely.to_geojson(_tidy(part)))}
        for part in sorted(polygons, key=lambda part: -part.area)
    ]
    collection = {"type": "FeatureCollection", "features": features}
    TARGET.write_text(json.dumps(collection, separators=(",", ":")) + "\n", encoding="utf-8")
    print(f"{len(features)} polygons, {TARGET.stat().st_size / 1000:.0f} kB: {TARGET}")


def _tidy(polygon: shapely.Polygon) -> shapely.Polygon:
    """Six decimals (0.1 m), exterior ring counter-clockwise as RFC 7946 asks."""
    rounded = shapely.set_precision(polygon, 1e-6)
    return shapely.geometry.polygon.orient(rounded, 1.0)


if __name__ == "__main__":
    main()
