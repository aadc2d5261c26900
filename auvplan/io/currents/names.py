"""Which variables of a file are the current and its places: by CF standard name first, then by name."""

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvplan.io.currents.files import File, same_values, text
from auvplan.io.currents.units import length_factor, speed_factor
from auvplan.ocean.gridded import CurrentError

#: Standard names of velocities to true east, and along the grid's own axes.
_TRUE = re.compile(r"(surface_)?eastward_sea_water_velocity(_assuming_no_tide)?")
_ALONG = re.compile(r"(surface_)?sea_water_x_velocity|x_sea_water_velocity")
#: Those of a part or a mean of the current, which is read where nothing else is given.
_PART = re.compile(r"(surface_)?(geostrophic|barotropic)_(eastward_sea_water|sea_water_x)_velocity")
#: What else velocities are of, in words about a variable, and what marks the sea's in spite of them.
_OTHER = re.compile(r"\b(wind|air|atmospher\w*|ice|stokes)\b")
_WATER = re.compile(r"\b(currents?|(sea|ocean) ?water)\b(?!.*\b(stokes|ice)\b)")
#: Methods whose result is the current of no moment.
_EXTREME = re.compile(r"time\s*:\s*(max|min|range|standard_deviation|variance|sum)")
#: Names of the two components, the likeliest first.
_PAIRS = (
    ("uo", "vo"), ("utotal", "vtotal"), ("water_u", "water_v"), ("u_eastward", "v_northward"),
    ("u", "v"), ("u_sur", "v_sur"), ("horizontalVelX", "horizontalVelY"), ("U_hvel", "V_hvel"),
    ("vozocrtx", "vomecrty"), ("UVEL", "VVEL"), ("unod", "vnod"), ("ssu", "ssv"), ("u-vel", "v-vel"),
    ("u_velocity", "v_velocity"), ("ugos", "vgos"),
)  # fmt: skip
#: SCHISM's velocity, both components in one variable along a last dimension.
_BOTH = "hvel"
#: Names of the vertical velocity, positive up.
UPWARD = ("w", "wo", "ww", "vertical_velocity", "verticalVelocity")
_PLACES = {
    "longitude": ("longitude", "lon", "nav_lon", "lon_rho", "Longitude", "lonc", "LON", "LONGITUDE",
                  "SCHISM_hgrid_node_x"),
    "latitude": ("latitude", "lat", "nav_lat", "lat_rho", "Latitude", "latc", "LAT", "LATITUDE",
                 "SCHISM_hgrid_node_y"),
}  # fmt: skip
#: Units of longitudes and of latitudes (CF 4.1 and 4.2).
DEGREES = {
    "longitude": re.compile(r"degrees?_?(e|east|w|west)", re.IGNORECASE),
    "latitude": re.compile(r"degrees?_?(n|north|south)|degrees?_s", re.IGNORECASE),
}
_FLOOR_NAMES = ("sea_floor_depth_below_sea_level", "sea_floor_depth_below_geoid", "sea_floor_depth",
                "model_sea_floor_depth_below_geoid")  # fmt: skip

#: Masks of land by name, 1 is water: ROMS, NEMO, MITgcm and MOM6; and by standard name.
MASKS = ("mask_rho", "tmask", "maskC", "hFacC", "wet")
MASK_NAMES = ("sea_binary_mask", "land_binary_mask")
#: Heights of levels above the datum, as SCHISM and SELFE give them, and shares of the depth.
HEIGHTS = ("zcor", "zCoordinates", "zval")
SIGMAS = ("siglay", "sigma", "siglev")


class PartnerMissing(CurrentError):
    """A file holds one component of a current without the other."""


@dataclass(frozen=True)
class Names:
    """The variables that are the current."""

    east: str  # names of the components; the same where one variable holds both
    north: str
    both: str | None  # the dimension along which one variable holds both components, or None
    along_grid: bool  # whether they may follow the grid's axes rather than east and north
    note: str = ""  # what they are not all of the current of; empty where they are


def find_current(file: File) -> Names:
    """Return the level components of the current.

    Raises:
        CurrentError: there are none, or one without the other.
    """
    by_standard: dict[str, list[str]] = {}
    for name in file.variables:
        mesh = file.text(name, "mesh")
        # A network of lines is such as the 1D part of D-Flow's rivers.
        network = mesh in file.variables and file.text(mesh, "topology_dimension") == "1"
        if not network and _is_current(file, name):
            by_standard.setdefault(file.standard_name(name), []).append(name)
    found = [_by_standard(file, by_standard, wanted) for wanted in (_TRUE, _ALONG)]
    with contextlib.suppress(CurrentError) if any(found) else contextlib.nullcontext():
        found.append(_by_name(file))
    if not any(found):
        found = [_by_standard(file, by_standard, _PART)]
    found = [names for names in found if names is not None]
    if not found:
        raise file.fail(
            f"no current: neither a variable with standard_name eastward_sea_water_velocity "
            f"nor one named {', '.join(east for east, _ in _PAIRS)}{_remedy(file)}"
        )
    # A current at the surface may stand beside that at all levels.
    return max(found, key=lambda names: file.variables[names.east].ndim - (names.both is not None))


def _by_standard(file: File, by_standard: dict[str, list[str]], wanted: re.Pattern[str]) -> Names | None:
    """Return the components whose standard names are of a kind, None where there are none."""
    for standard in sorted(filter(wanted.fullmatch, by_standard), key=len):
        across = standard.replace("eastward", "northward").replace("x_", "y_")
        east = _best(file, by_standard[standard])
        ndim = file.variables[east].ndim
        partners = [name for name in by_standard.get(across, []) if file.variables[name].ndim == ndim]
        if not partners:
            raise PartnerMissing(f"{file.path}: {east} has no partner {across}")
        note = ""
        if part := _PART.fullmatch(standard):
            means = {"geostrophic": "its geostrophic part", "barotropic": "its mean over the depth"}
            note = f"{east} is {part[2]}: not the whole current is given, but {means[part[2]]}"
        return Names(east, _best(file, partners), None, "eastward" not in standard, note)
    return None


def _is_current(file: File, name: str) -> bool:
    """Return whether nothing in a variable's words says that it is a wind, ice, waves or an extreme."""
    words = " ".join(file.text(name, key) for key in ("standard_name", "long_name", "description"))
    words = words.lower().replace("_", " ").replace("-", " ")
    sea = _OTHER.search(words) is None or _WATER.search(words) is not None
    return sea and not _EXTREME.search(file.text(name, "cell_methods"))


def _remedy(file: File) -> str:
    """Return what may be done with a file in which no current is known."""
    standards = {file.standard_name(name): name for name in file.variables}
    turned = next((name for standard, name in standards.items() if "direction" in standard), None)
    if "sea_water_speed" in standards and turned is not None:
        return (
            f"; compute them from {standards['sea_water_speed']} and {turned}, as uo = speed sin(direction) "
            "and vo = speed cos(direction), where that is the direction to which water flows"
        )
    swift = [
        name
        for name, variable in file.variables.items()
        if variable.ndim > 1 and _is_current(file, name) and speed_factor(file.text(name, "units"))
    ]
    if len(swift) < 2:
        passed = ", ".join(name for pair in _PAIRS for name in pair if name in file.variables)
        return passed and f"; {passed} are by their attributes of wind, ice, waves or extremes"
    return (
        f"; speeds are {', '.join(swift[:8])}: rename the two that are eastward and northward, such as by "
        f"ncrename -v {swift[0]},uo -v {swift[1]},vo"
    )


def _by_name(file: File) -> Names | None:
    for east, north in _PAIRS:
        if east in file.variables and north in file.variables:
            names = [file.standard_name(name) for name in (east, north)]
            if re.search("northward|_y_|^y_", names[0]) or re.search("eastward|_x_|^x_", names[1]):
                stated = " and ".join(name or "none" for name in names)
                raise file.fail(f"{east} and {north} have standard names {stated}: in doubt")
            whole = not any(map(_PART.fullmatch, names))
            if whole and _is_current(file, east) and _is_current(file, north):
                return Names(east, north, None, "east" not in east)
    if _BOTH in file.variables and file.variables[_BOTH].shape[-1] == 2:
        return Names(_BOTH, _BOTH, str(file.variables[_BOTH].dims[-1]), True)
    for east, north in _PAIRS:
        for present, missing in ((east, north), (north, east)):
            if present in file.variables and missing not in file.variables:
                raise PartnerMissing(f"{file.path}: {present} has no partner {missing}")
    return None


def _best(file: File, names: Sequence[str]) -> str:
    """Return the variable with most dimensions; among equals a well-known name, then the first."""
    known = [name for pair in _PAIRS for name in pair]

    def rank(name: str) -> tuple[int, int]:
        return -file.variables[name].ndim, known.index(name) if name in known else len(known)

    return min(names, key=rank)


def require_field(file: File) -> None:
    """Refuse measurements and model output at single places, between which nothing is known.

    Raises:
        CurrentError: the file says that it holds such.
    """
    roles = [file.text(name, "cf_role") for name in file.variables]
    dims = [str(dim) for variable in file.variables.values() for dim in variable.dims]
    stated = [text(file.attributes, "featureType"), *(role for role in roles if role.endswith("_id"))]
    stated += [dim for dim in dims if "station" in dim.lower()]
    if any(stated):
        raise file.fail(
            f"holds single places ({next(filter(None, stated))}), between which the current is not known: a "
            "model's output on a grid or a mesh is needed"
        )


def find_places(file: File, name: str, staggered: bool = False) -> tuple[str, str]:
    """Return the longitude and latitude of a variable's points; staggered, of ROMS' rho points.

    Raises:
        CurrentError: they are missing.
    """
    if staggered:
        pair = ("lon_rho", "lat_rho")
        for place in pair:
            if place not in file.variables or not np.nan_to_num(file.coordinate(place, missing=True)).any():
                raise file.fail(f"{name} is on a staggered grid, but {place} is missing")
        return pair
    own = file.variables[name].dims
    near = [
        other
        for other, variable in file.variables.items()
        if variable.ndim in (1, 2) and set(variable.dims) <= set(own) and other != name
    ]
    found = [_place(file, name, near, kind) for kind in _PLACES]
    if None in found:  # coordinates along the axes of a projection or of a turned pole may stand for them
        plane = []
        for axis, turned in (("x", "grid_longitude"), ("y", "grid_latitude")):
            standard = f"projection_{axis}_coordinate", turned
            stated = sorted(one for one in near if file.standard_name(one) in standard)
            plain = sorted(one for one in near if one.lower() in (axis, f"{axis}c"))
            given = (one for one in (*stated, *plain) if np.any(file.coordinate(one, missing=True)))
            plane += [*given][:1]
        found = plane if len(plane) == 2 else found
    for kind, place in zip(_PLACES, found, strict=True):
        if place is None:
            raise file.fail(
                f"{name} has no {kind}: name the model's grid file beside it in current.files, if it has one"
            )
    return str(found[0]), str(found[1])


def _place(file: File, of: str, near: Sequence[str], kind: str) -> str | None:
    """Return the longitude or latitude of a variable's points, or None; refuse two that are as likely."""
    names, hints, ranked = _PLACES[kind], file.text(of, "coordinates").split(), []
    for name in near:
        standard = file.standard_name(name) == kind
        degrees = DEGREES[kind].fullmatch(file.text(name, "units")) is not None
        if standard or degrees or name in names:
            order = names.index(name) if name in names else len(names)
            ranked.append(((name not in hints, not standard, not degrees, order), name))
    ranked.sort()
    if len(ranked) > 1 and ranked[0][0] == ranked[1][0] and ranked[0][0][0]:
        first, second = (name for _, name in ranked[:2])
        one, two = file.variables[first], file.variables[second]
        if one.ndim > 1 and one.dims == two.dims:
            left, right = (np.nan_to_num(file.coordinate(name, missing=True)) for name in (first, second))
            if left.any() and right.any() and not same_values(left, right):
                raise file.fail(
                    f"the {kind} of {of} may be {first} or {second}: write which, such as by "
                    f"ncatted -a coordinates,{of},o,c,'{first} ...'"
                )
    for _, name in ranked:
        variable = file.variables[name]
        if variable.ndim == variable.size == 1:
            return name
        # Models leave coordinates of grids that they do not write at zero.
        if np.nan_to_num(file.coordinate(name, missing=variable.ndim == 2)).any():
            return name
    return None


def find_floor(file: File, dims: Sequence[str]) -> str | None:
    """The sea bed on the dimensions of places: by standard name, ROMS' and FVCOM's h, D-Flow's altitude."""
    fitting = [name for name, variable in file.variables.items() if set(variable.dims) == set(dims)]
    named = [name for name in fitting if file.standard_name(name) in _FLOOR_NAMES]
    plain = [name for name in ("h", "deptho", "bathymetry") if name in fitting]
    if "SCHISM_hgrid" in file.variables and "depth" in fitting:
        plain.append("depth")
    plain += [n for n in fitting if n.endswith("flowelem_bl") and file.standard_name(n) == "altitude"]
    return (named + plain + [None])[0]


def is_level(file: File, dim: str) -> bool:
    """Return whether a file defines where levels along a dimension lie."""
    return depth_axis(file, dim) is not None or any(
        dim in variable.dims
        and (name in (*HEIGHTS, *SIGMAS) or file.standard_name(name).startswith("ocean_s"))
        for name, variable in file.variables.items()
    )


def is_vertical(file: File, name: str) -> bool:
    """Return whether a variable says that it is a depth or a height."""
    standard = file.standard_name(name)
    known = standard == "depth" or standard.startswith(("height", "altitude"))
    return known or bool(file.text(name, "positive") and length_factor(file.text(name, "units")))


def depth_axis(file: File, dim: str) -> str | None:
    """Return the variable with the depths along a dimension, None where there is none."""
    found = []
    for name, variable in file.variables.items():
        if variable.dims != (dim,) or variable.dtype.kind not in "iuf":
            continue
        standard, named = is_vertical(file, name), "depth" in name.lower()
        axis = file.text(name, "axis") == "Z" or file.text(name, "positive")
        if not (standard or named or name == dim or axis):
            continue
        if not (standard or named or file.text(name, "units")):
            # The numbers of levels, or members, from 0 or 1.
            values = file.coordinate(name)
            if values[0] in (0.0, 1.0) and (np.diff(values) == 1.0).all():
                continue
        found.append((standard, name == dim, name))
    return max(found)[2] if found else None
