"""Files of places on Earth, brought to local metres: charts, closed areas, the sea floor, jobs."""

from auvplan.io.geo.bathymetry import Bathymetry, read_bathymetry
from auvplan.io.geo.charts import Zone, chart_from_polygons, chart_from_raster, read_zones, with_no_go
from auvplan.io.geo.error import GeoError
from auvplan.io.geo.jobs import read_jobs
from auvplan.io.geo.raster import Raster, read_raster

__all__ = [
    "Bathymetry",
    "GeoError",
    "Raster",
    "Zone",
    "chart_from_polygons",
    "chart_from_raster",
    "read_bathymetry",
    "read_jobs",
    "read_raster",
    "read_zones",
    "with_no_go",
]
