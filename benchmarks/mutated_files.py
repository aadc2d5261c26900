"""Damaged and altered copies of the real files: ``python -m benchmarks.mutated_files --out FILE``.

Each copy must be refused by one line, within 30 s of processor time and 4 GB, or be read right: as the
original where the change bears on nothing that is read or on bytes, else as the other libraries of
`benchmarks.file_references` and `benchmarks.file_rasters` read the copy. All else is a failure and is
listed.
"""

import json
import re
import resource
import shutil
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.errors import AuvplanError
from auvplan.io.currents import open_ocean
from benchmarks.apart import run_apart, within
from benchmarks.file_models import REAL, Currents
from benchmarks.file_rasters import RASTERS, Rasters
from benchmarks.file_references import Table
from benchmarks.files import largest, node_values
from benchmarks.fuzz.changes import damage
from benchmarks.harness import Rng, launch

COPIES, POINTS = 500, 40
SECONDS, BYTES = 30, 4 << 30
#: m/s, and share of a chart's pixels.
SAME = 1e-4
#: m/s, for places that are not given and taken from others, which a note says.
NEAR, _MEANS = 0.05, "means of their corners"

#: A change: what it is, and whether the copy must read as the original ("same"), as the copy is read by other
#: libraries ("copy"), or as either ("either"); and new names of variables.
Change = tuple[str, str, dict[str, str]]


#: Attributes of a mapping, which a file with longitudes and latitudes need not heed.
_MAPPING = ("straight_vertical_longitude_from_pole", "standard_parallel", "proj4", "proj4_string", "epsg",
            "grid_mapping")  # fmt: skip
_VALUES: dict[str, tuple[Any, ...]] = {
    "units": ("cm s-1", "knots", "m", "furlong", "degrees_north", "km", "seconds since 1990-01-01",
              "days since 1950-01-01", "hours since 1990-01-01 00:00:00", ""),
    "standard_name": ("eastward_wind", "northward_sea_water_velocity", "EASTWARD_SEA_WATER_VELOCITY",
                      "longitude", "latitude", "depth", "sea_ice_x_velocity"),
    "positive": ("up", "down", "left"),
    "calendar": ("noleap", "360_day", "julian", "proleptic_gregorian", "gregorian_proleptic", "martian"),
    "_FillValue": (0.0, 1.0, -1.0, 1e20),
    "missing_value": (0.0, 1e20),
    "scale_factor": (0.01, 1.0, -1.0, 0.0),
    "add_offset": (0.0, 1.0, 100.0),
    "coordinates": ("", "x y", "lat lon time"),
    "grid_mapping": ("", "nowhere", "time"),
    "axis": ("X", "Y", "Z", "T"),
    "start_index": (0, 1, 7),
    "cf_role": ("", "mesh_topology"),
    "node_coordinates": ("", "nowhere nowhere2"),
    "face_node_connectivity": ("", "nowhere"),
    "valid_range": (np.array([-0.1, 0.1]),),
    "standard_parallel": (45.0,),
    "straight_vertical_longitude_from_pole": (0.0, 90.0),
    "epsg": (4326, 32633, 0),
    "proj4": ("", "+proj=utm +zone=33"),
    "proj4_string": ("", "+proj=utm +zone=33"),
}  # fmt: skip


def attribute(data: xr.Dataset, names: list[str], rng: Rng) -> Change:
    """Take an attribute away, change it, or add one."""
    name = str(rng.choice(names))
    stated, kind = data[name].attrs, data[name].dtype.kind
    likely = [key for key in _VALUES if key in stated]
    common = ["units", "standard_name", "positive", "calendar", "scale_factor", "_FillValue"]
    key = str(rng.choice(likely if likely and rng.random() < 0.8 else common))
    expect = "either" if key in _MAPPING else "copy"
    if key in stated and rng.random() < 0.4:
        del stated[key]
        return f"{key} of {name} taken away", expect, {}
    value = _VALUES[key][int(rng.integers(len(_VALUES[key])))]
    if key in ("_FillValue", "missing_value"):
        if kind not in "iuf" or (kind != "f" and abs(value) >= 1e4):
            return "nothing", "same", {}
        value = data[name].dtype.type(value)
    stated[key] = value
    return f"{key} of {name} = {value}", expect, {}


def structure(
    data: xr.Dataset, variables: tuple[str, ...], rng: Rng
) -> tuple[xr.Dataset, str, dict[str, str]]:
    """Reverse, permute, rename, drop, blank or double parts of a file."""
    there = [name for name in variables if name and name in data.variables]
    kind = int(rng.integers(11))
    name = str(rng.choice(there))
    dims = [str(dim) for n in there for dim in data[n].dims if data.sizes[dim] > 1]
    dim = str(rng.choice(dims))
    own, lon, lat = data[name], *variables[2:4]
    time_dims = data[variables[5]].dims if len(variables) > 5 and variables[5] in data.variables else ()
    if kind == 0:
        dim = str(rng.choice([d for d in dims if d.split("_")[0] not in ("xi", "eta")] or dims))
        return data.isel({dim: slice(None, None, -1)}), f"{dim} reversed", {}
    if kind == 1 and own.ndim:
        data[name] = (own.dims, own.values[::-1], own.attrs)
        return data, f"values of {name} reversed", {}
    if kind == 2:
        route = [str(d) for d in rng.permutation(own.dims)]
        data[name] = own.transpose(*route)
        return data, f"{name} transposed to {' '.join(route)}", {}
    if kind == 3:
        data = data.map(lambda part: part.transpose(*part.dims[::-1]), keep_attrs=True)
        return data, "all variables transposed", {}
    if kind == 4:
        other = str(rng.choice([f"{name}_2", "velocity", name.upper() + "X"]))
        return data.rename({name: other}), f"{name} renamed {other}", {name: other}
    if kind == 5:
        lost = str(rng.choice([str(n) for n in data.variables]))
        return data.drop_vars(lost), f"{lost} dropped", {}
    if kind == 6 and own.dtype.kind == "f" and own.ndim:
        values = own.values.copy()
        block = tuple(slice(int(a := rng.integers(n)), int(a + rng.integers(1, n + 1))) for n in values.shape)
        values[block] = np.nan
        data[name] = (own.dims, values, own.attrs)
        return data, f"NaN in {name}", {}
    if kind == 7 and time_dims:
        how = {"data_vars": "minimal", "coords": "minimal", "compat": "override", "join": "override"}
        return xr.concat([data, data], time_dims[0], **how), "times doubled", {}
    if kind == 8 and time_dims and data.sizes[time_dims[0]] > 1:
        shuffled = np.argsort(rng.random(data.sizes[time_dims[0]]))
        return data.isel({time_dims[0]: shuffled}), "times shuffled", {}
    if kind == 9 and lon in data.variables:
        axis = data[lon]
        if axis.dtype.kind == "f" and "scale_factor" not in axis.attrs:
            turned = axis.values % 360.0 if rng.random() < 0.5 else (axis.values + 180.0) % 360.0 - 180.0
            if str(axis.attrs.get("units", "")).lower().startswith("deg"):
                data = data.assign_coords({lon: (axis.dims, turned, axis.attrs)})
                return data, f"{lon} in another turn", {}
    both = kind == 10 and lon in data.variables and lat in data.variables
    if both and (data[lon].ndim == 2 or data[lon].dims == data[lat].dims):
        swapped = data.rename({lon: "swap_", lat: lon}).rename({"swap_": lat})
        return swapped, "longitude and latitude under each other's names", {lon: lat, lat: lon}
    return data.isel({dim: slice(0, max(data.sizes[dim] // 2, 2))}), f"{dim} halved", {}


def netcdf(path: Path, variables: tuple[str, ...], rng: Rng) -> Change:
    if rng.random() < 0.35:
        return damage(path, rng), "either", {}
    data = _loaded(path)
    there = [name for name in variables if name and name in data.variables]
    if not there:
        return damage(path, rng), "either", {}
    try:
        if rng.random() < 0.6:
            mapping = {"grid_mapping_name", "cf_role"}
            more = [str(n) for n, v in data.variables.items() if mapping & set(v.attrs)]
            likely = ("angle", "h", "zeta", "mask_rho", "hc", "Cs_r", "ele", "nv")
            more += [name for name in likely if name in data.variables]
            change = attribute(data, there * 3 + more, rng)
        else:
            data, said, names = structure(data, variables, rng)
            change = said, "copy", names
        _rewrite(path, data)
    except Exception as error:  # what no library writes
        return f"not written: {type(error).__name__}", "same", {}
    return change


def _loaded(path: Path) -> xr.Dataset:
    """A NetCDF file as it is, packed values and all."""
    with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as file:
        data = file.load()
    for variable in data.variables.values():
        variable.encoding = {}
    return data


def _rewrite(path: Path, data: xr.Dataset) -> None:
    """Put a dataset in the place of a file, in the same format."""
    form = "NETCDF3_64BIT" if path.read_bytes()[:3] == b"CDF" else "NETCDF4"
    fresh = path.with_suffix(".new")
    data.to_netcdf(fresh, engine="netcdf4", format=form)
    fresh.replace(path)


def text(path: Path, rng: Rng) -> Change:
    if rng.random() < 0.5:
        return damage(path, rng), "either", {}
    root = json.loads(path.read_text())
    features = root["features"]
    whole = [feature for feature in features if feature["geometry"]["coordinates"]]
    feature = whole[int(rng.integers(len(whole)))]
    rings = feature["geometry"]["coordinates"]
    ring = rings[0] if feature["geometry"]["type"] == "Polygon" else rings[0][0]
    kind = int(rng.integers(9))
    place = int(rng.integers(len(ring))) if kind == 1 else 0
    crs = str(rng.choice(("4326", "CRS84", "EPSG:32755"))) if kind == 5 else ""
    turned = [[position[0] + 360.0, *position[1:]] for position in ring]
    swapped = [[*position[1::-1], *position[2:]] for position in ring]
    said, expect, apply = (
        ("a feature dropped", "copy", lambda: features.remove(feature)),
        ("NaN in a ring", "copy", lambda: ring.__setitem__(place, [float("nan"), 0.0])),
        ("a ring's longitude and latitude swapped", "copy", lambda: ring.__setitem__(slice(None), swapped)),
        ("a ring opened", "copy", ring.pop),
        ("a ring reversed", "same", ring.reverse),
        (f"crs {crs}", "same", lambda: root.update(crs={"type": "name", "properties": {"name": crs}})),
        ("a geometry taken away", "copy", lambda: feature.update(geometry=None)),
        ("a ring one turn further east", "same", lambda: ring.__setitem__(slice(None), turned)),
        ("a feature doubled", "same", lambda: features.append(feature)),
    )[kind]
    apply()
    path.write_text(json.dumps(root))
    return said, expect, {}


def tiff(path: Path, rng: Rng) -> Change:
    if rng.random() < 0.6:
        return damage(path, rng), "either", {}
    import rasterio

    with rasterio.open(path) as source:
        profile, values = source.profile, source.read()
    kind, t, expect = int(rng.integers(7)), profile["transform"], "copy"
    if kind == 0:
        said, values = "rows from the south", values[:, ::-1]
        profile["transform"] = rasterio.Affine(t.a, t.b, t.c, t.d, -t.e, t.f + t.e * values.shape[1])
    elif kind == 1:
        profile["crs"] = str(rng.choice(["EPSG:4326", "EPSG:32755", "EPSG:3857"]))
        said = f"crs {profile['crs']}"
    elif kind == 2:
        said, _ = "crs taken away", profile.pop("crs")
    elif kind == 3:
        profile["nodata"] = float(values.flat[int(rng.integers(values.size))])
        said = f"nodata {profile['nodata']:g}"
    elif kind == 4:
        said = "three pixels further east"
        profile["transform"] = rasterio.Affine(t.a, t.b, t.c + 3 * t.a, t.d, t.e, t.f)
    elif kind == 5:
        profile |= {"tiled": True, "blockxsize": 16, "blockysize": 16,
                    "compress": str(rng.choice(["lzw", "deflate", "none", "zstd"])),
                    "interleave": str(rng.choice(["band", "pixel"]))}  # fmt: skip
        said, expect = f"tiled, {profile['compress']}, by {profile['interleave']}", "same"
    else:
        said, values = "a third of the rows even", values.copy()
        values[:, : values.shape[1] // 3] = values.flat[0]
    with rasterio.open(path, "w", **profile) as sink:
        sink.write(values)
    return said, expect, {}


def thin(path: Path, variables: tuple[str, ...]) -> None:
    """Leave four times of a file, and of its fields those that bear on a current."""
    data = _loaded(path)
    time_dims = [d for d in data.dims if "time" in str(d).lower() or d == "tl"]
    kept = {*variables, "zeta", "w", "hc", "Vtransform", "dryFlagNode", "SCHISM_hgrid"}
    lost = [
        name
        for name, variable in data.data_vars.items()
        if name not in kept
        and (variable.ndim > 2 or (not variable.ndim and "cf_role" not in variable.attrs))
        and "grid_mapping_name" not in variable.attrs
    ]
    _rewrite(path, data.isel({dim: slice(0, 4) for dim in time_dims}).drop_vars(lost))


def sampled(table: Table) -> tuple[np.ndarray, ...]:
    """Longitudes, latitudes, depths and moments [M] of points, levels and times that have a current."""
    return node_values(table, np.random.default_rng(1), POINTS)[:4]


def expected(table: Table, sample: tuple[np.ndarray, ...]) -> np.ndarray:
    """[2, M] m/s by the table's own interpolation."""
    found = []
    for lon, lat, depth, moment in zip(*sample, strict=True):
        mixture = table.mixture(float(lon), float(lat))
        missing = mixture is None
        found.append(np.full(2, np.nan) if missing else table.at(*mixture, float(depth), float(moment)))
    return np.transpose(found)


def current(
    case: Currents, paths: list[Path], options: dict[str, Any], change: Change, original: Table
) -> str:
    """What became of a copy of a current's files."""
    _, expect, names = change
    with open_ocean(paths, **options) as ocean:
        table, why = original, ""
        try:
            if expect != "same":
                table = case.reading(paths, renamed=names)
        except Exception as error:
            table, why = None, f"{type(error).__name__}: {error}"
        base = original if table is None else table
        if nothing := not (np.isfinite(base.east) & np.isfinite(base.depth)).any():
            table, base, why = None, original, "no current anywhere"
        sample = sampled(base)
        found = np.stack(ocean.at(*sample)[:2])
        if nothing and np.isnan(found).all():
            return "right: no current anywhere"
        wanted = None if table is None else expected(table, sample)
        if wanted is not None and np.isnan(wanted).any():
            known = np.isfinite(wanted).all(axis=0)
            found, wanted = found[:, known], wanted[:, known]
        off, plain = np.inf if wanted is None else largest(found, wanted), np.inf
        if off <= SAME:
            return "right"
        if expect == "either" or wanted is None:
            sample = sampled(original)
            plain = largest(ocean.at(*sample), expected(original, sample))
            if plain <= SAME:
                return "right: as the original"
        if min(off, plain) <= NEAR and any(_MEANS in note for note in ocean.notes):
            return "right: with a note"
        because = f" ({why})" if why else ""
        return f"off by {min(off, plain):.3g} m/s{because}; notes: {'; '.join(ocean.notes)}"


def raster(case: Rasters, path: Path, change: Change, original: np.ndarray) -> str:
    """What became of a copy of a sea bed or a chart."""
    found, wanted, why = np.asarray(case.read(path), float), None, ""
    try:
        wanted = None if change[1] == "same" else np.asarray(case.expect(path), float)
    except Exception as error:
        why = f" ({type(error).__name__}: {error})"

    def far(expected: np.ndarray | None) -> float:
        if expected is None or expected.shape != found.shape:
            return np.inf
        return 1.0 - case.equal(found, expected)

    off, plain = far(wanted), far(original)
    if off <= SAME:
        return "right"
    if plain <= SAME and (change[1] != "copy" or wanted is None):
        return "right: as the original"
    return f"{min(off, plain if wanted is None else off):.2%} of the pixels differ{why}"


def outcome(work: Callable[[], str]) -> str:
    """What became of a copy; a refusal in one line is one, all else that is raised is a failure."""
    try:
        with within(SECONDS):
            return work()
    except AuvplanError as error:
        line = str(error)
        clean = "\n" not in line and len(line) < 900 and "MemoryError" not in line
        return f"refused: {line}" if clean else f"unclean refusal: {line[:200]}"
    except BaseException as error:
        return f"raised {type(error).__name__}: {str(error)[:200]}"


def copies_of(case: Currents | Rasters, pipe: Any) -> None:
    """Make copies and report what became of each; runs in a process of its own."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        kept, folder = Path(name) / "kept", Path(name) / "copy"
        kept.mkdir()
        whole, options = case.prepare(kept)
        if isinstance(case, Currents):
            for path in whole:
                thin(path, case.variables)
            original: Any = case.reading(whole)
        else:
            original = np.asarray(case.expect(whole[0]), float)
        for number in iter(pipe.recv, None):
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(kept, folder)
            paths = [folder / path.name for path in whole]
            rng = np.random.default_rng([number, *case.name.encode()])
            path = paths[int(rng.integers(len(paths)))]
            by_format = {".geojson": text, ".tif": tiff, ".nc": partial(netcdf, variables=case.variables)}
            change = by_format[path.suffix](path, rng=rng)
            pipe.send(change[0])
            work = partial(raster, case, paths[0], change, original)
            if isinstance(case, Currents):
                work = partial(current, case, paths, options, change, original)
            pipe.send((outcome(work),))


@launch(
    out=(Path, "JSON file for the counts; those of other files there are kept"),
    copies=(COPIES, "of each file"),
    only=("", "part of the names of files"),
)
def main(out: Path | None, copies: int, only: str) -> None:
    counts = json.loads(out.read_text()) if out and out.exists() else {}
    rasters = [case for case in RASTERS if case.origin == "real" and not case.name.endswith("png")]
    for case in [case for case in (*REAL, *rasters) if only in case.name]:
        begin, found, failures = time.perf_counter(), Counter(), []
        for number, change, became in run_apart(copies_of, (case,), range(copies), "fork"):
            fault = not became.startswith(("refused", "right"))
            found["failed" if fault else became.split(":")[0]] += 1
            failures += [f"{change}: {became}"] * fault
            if fault:
                print(f"  {number}: {change}: {re.sub(r'/tmp/[^ :]*/', '', became)}", flush=True)
        counts[case.name] = dict(found) | {"copies": found.total(), "failures": failures}
        print(f"{case.name}: {dict(found)}, {time.perf_counter() - begin:.0f} s", flush=True)
        if out:
            out.write_text(json.dumps(counts, indent=1) + "\n")
