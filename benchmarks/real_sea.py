"""Real data in, vehicle files out, and how well it goes.

    python -m benchmarks.real_sea

Reads the current files of ../shared/data and compares values at random nodes with the files' own; plans a leg
through a fjord for each of its 24 hours; simulates a mission on a real chart between the Whitsunday Islands
in a synthetic tide over a synthetic sea bed, checks it and writes every export. Needs ../shared.
"""

import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import xarray as xr
import yaml

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.export import export_run
from auvplan.io.currents import OceanData, open_ocean
from auvplan.io.example import write_example

DATA = Path(__file__).parent.parent / ".." / "shared" / "data"
FILES = {
    "cmems_glo12_uo_vo_northsea.nc": ("uo", "vo"),
    "norkyst_v3_800m_5h.nc": ("u_eastward", "v_northward"),
    "rtofs_water_u_v_washington_64x3h.nc": ("water_u", "water_v"),
    "norfjords160_roms_native_24h.nc": ("u", "v"),
}
#: Nodes compared in each file.
NODES = 20


def own_values(path: Path, names: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """East and north velocity [T, Z, Y, X] as xarray has them; those of ROMS averaged and rotated here."""
    engine = "scipy" if path.name.startswith("rtofs") else "h5netcdf"
    with xr.open_dataset(path, engine=engine) as dataset:
        u, v = (dataset[name].values.astype(float) for name in names)
        if names != ("u", "v"):
            return tuple(field if field.ndim == 4 else field[:, None] for field in (u, v))  # type: ignore
        angle = dataset["angle"].values
        wide = np.full((*u.shape[:2], *angle.shape), np.nan)
        tall = wide.copy()
        wide[..., 1:-1] = 0.5 * (u[..., 1:] + u[..., :-1])
        tall[..., 1:-1, :] = 0.5 * (v[..., 1:, :] + v[..., :-1, :])
        return wide * np.cos(angle) - tall * np.sin(angle), wide * np.sin(angle) + tall * np.cos(angle)


def depth_of(data: OceanData, path: Path, node: tuple[int, ...]) -> float:
    """Depth, m, of a node (time, level, row, column)."""
    if data.levels is not None:
        return float(data.levels[node[1]])
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        h, zeta = dataset["h"].values[node[2:]], dataset["zeta"].values[(node[0], *node[2:])]
        s, stretched = dataset["s_rho"].values[node[1]], dataset["Cs_r"].values[node[1]]
        hc = float(dataset["hc"])
    share = (hc * s + h * stretched) / (hc + h)  # Vtransform 2
    return float(-(zeta + h) * share)


def compared() -> Iterator[str]:
    """A line for each file: largest difference at random nodes, m/s."""
    for name, variables in FILES.items():
        path, rng = DATA / "currents" / name, np.random.default_rng(1)
        east, north = own_values(path, variables)
        water = np.argwhere(np.isfinite(east) & np.isfinite(north))
        worst = 0.0
        with open_ocean(path) as data:
            longitude, latitude = np.broadcast_arrays(*_mesh(data, east.shape[2:]))
            for node in map(tuple, rng.choice(water, NODES, replace=False)):
                depth = depth_of(data, path, node)
                place = longitude[node[2:]], latitude[node[2:]]
                found = data.at(*place, depth, data.moments[node[0]])
                error = abs(float(found[0]) - east[node]), abs(float(found[1]) - north[node])
                worst = float(np.max([worst, *error]))  # a missing value shows
        yield f"{name:40} {NODES} nodes, largest difference {worst:.1e} m/s"


def _mesh(data: OceanData, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    longitude, latitude = np.asarray(data.longitude), np.asarray(data.latitude)
    if longitude.ndim == 1 and longitude.size != int(np.prod(shape)):
        return longitude[None, :], latitude[:, None]
    return longitude.reshape(shape), latitude.reshape(shape)


def fjord() -> str:
    """One leg around an islet at each hour of a day."""
    site = ap.Site(5.67686, 59.03289)
    lower, upper = (-460.0, -350.0, 0.0), (770.0, 480.0, 20.0)
    begin = time.perf_counter()
    read = ap.read_current(
        DATA / "currents" / "norfjords160_roms_native_24h.nc", site, lower=lower, upper=upper, spacing=40.0
    )
    seconds = time.perf_counter() - begin
    corner = (read.origin[0] - 0.5 * read.spacing[0], read.origin[1] - 0.5 * read.spacing[1])
    chart = ap.Chart.from_mask(read.water, float(np.mean(read.spacing)), corner)
    env = ap.Environment(read.field, chart, lower=lower, upper=upper)
    start, goal = np.array([700.0, 300.0, 2.0]), np.array([-450.0, 100.0, 2.0])
    departs = np.asarray(read.field.times)[:24]
    plans = ap.plan_paths(
        np.tile(start, (24, 1)), np.tile(goal, (24, 1)), env, ap.Vehicle(speed=1.5), key=jax.random.key(0),
        config=ap.PathConfig.quick(), depart=departs,
    )  # fmt: skip
    times = plans.travel_time
    return (
        f"norfjords160: read in {seconds:.2f} s; {int(plans.feasible.sum())} of 24 hourly legs feasible, "
        f"{times.min():.0f} to {times.max():.0f} s for {np.linalg.norm(goal - start):.0f} m"
    )


def islands(folder: Path) -> Iterator[str]:
    """A mission on the real chart."""
    write_example(folder)
    settings = yaml.safe_load((folder / "scenario.yaml").read_text())
    chart = (DATA / "maps" / "whitsunday_hamilton_dent_rgb.tif").resolve()
    settings["chart"] = {"source": "raster", "file": str(chart), "no_go": "no_go.geojson"}
    settings["area"] = {"lower": [-4300, -4700, 0], "upper": [4800, 4500, 50]}
    settings["current"]["forecast_error"] = 0.1
    jobs = json.loads((folder / "jobs.geojson").read_text())
    jobs["features"] = [job for job in jobs["features"] if _southernmost(job) > -20.38]  # on the chart
    (folder / "jobs.geojson").write_text(json.dumps(jobs))
    (folder / "real.yaml").write_text(yaml.safe_dump(settings))
    scenario = ap.load_scenario(folder / "real.yaml")
    for seed in range(3):
        run = ap.run_mission(scenario, key=jax.random.key(seed), seed=seed, folder=folder)
        ap.save_run(run, folder / str(seed))
        report, forecast = check_run(folder / str(seed)), run.forecast()
        files = export_run(run, folder / str(seed))
        yield (
            f"Whitsunday, seed {seed}: {run.reason}, priority {run.summary()['total_priority']:g}, "
            f"{report.collisions} collisions, {len(report.faults)} faults, least height above the bed "
            f"{report.seabed_altitude:.1f} m, least distance to the coast {report.coast_clearance:.0f} m"
        )
        if forecast:
            planned, executed = forecast["planned_s"], forecast["executed_s"]
            yield (
                f"  planned {planned:.0f} s, executed {executed:.0f} s in a current that differs by "
                f"{forecast['current_difference']:.2f} m/s; "
                + ", ".join(f"{file.name} {file.stat().st_size / 1e3:.0f} kB" for file in files)
            )


def _southernmost(job: dict) -> float:
    """Least latitude of a point or line, degrees."""
    return float(np.reshape(job["geometry"]["coordinates"], (-1, 2))[:, 1].min())


def main() -> None:
    """Print all lines."""
    if not DATA.is_dir():
        raise SystemExit(f"{DATA}: no such folder")
    for line in compared():
        print(line, flush=True)
    print(fjord(), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for line in islands(Path(folder)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
