from .bathymetry import Bathymetry as Bathymetry
from .bathymetry import read_bathymetry as read_bathymetry
from .charts import Land as Land
from .charts import Zone as Zone
from .charts import chart_and_notes as chart_and_notes
from .charts import chart_from_polygons as chart_from_polygons
from .charts import chart_from_raster as chart_from_raster
from .charts import closures_of as closures_of
from .charts import read_zones as read_zones
from .charts import with_no_go as with_no_go
from .error import GeoError as GeoError
from .grid import Extent as Extent
from .grid import LocalGrid as LocalGrid
from .jobs import read_jobs as read_jobs
from .nodes import fall as fall
from .obstacles import read_obstacles as read_obstacles
from .raster import pixel_size as pixel_size
from .raster import read_raster as read_raster
from .s57 import read_cells as read_cells

__all__ = [
    "Bathymetry",
    "Extent",
    "GeoError",
    "Land",
    "LocalGrid",
    "Zone",
    "chart_and_notes",
    "chart_from_polygons",
    "chart_from_raster",
    "closures_of",
    "fall",
    "pixel_size",
    "read_bathymetry",
    "read_cells",
    "read_jobs",
    "read_obstacles",
    "read_raster",
    "read_zones",
    "with_no_go",
]
