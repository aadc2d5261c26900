"""Real data in, vehicle files out: ``python -m benchmarks.real_sea``, with the data of ../shared.

Plans a leg through a fjord for each of its 24 hours; simulates missions on a real chart between the
Whitsunday Islands, checks them and writes every export.
"""

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.export import export_run
from auvplan.io.example import write_example
from benchmarks.harness import SHARED, clock, launch


def fjord() -> str:
    """One leg around an islet at each hour of a day."""
    site = ap.Site(5.67686, 59.03289)
    lower, upper = (-460.0, -350.0, 0.0), (770.0, 480.0, 20.0)
    file = SHARED / "currents" / "norfjords160_roms_native_24h.nc"
    seconds, read = clock(lambda: ap.read_current(file, site, lower=lower, upper=upper, spacing=40.0))
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
    write_example(folder)
    chart = (SHARED / "maps" / "whitsunday_hamilton_dent_rgb.tif").resolve()
    jobs = json.loads((folder / "jobs.geojson").read_text())
    south = [np.reshape(job["geometry"]["coordinates"], (-1, 2))[:, 1].min() for job in jobs["features"]]
    on_chart = zip(jobs["features"], south, strict=True)
    jobs["features"] = [job for job, latitude in on_chart if latitude > -20.38]
    (folder / "jobs.geojson").write_text(json.dumps(jobs))
    scenario = ap.load_scenario(folder / "scenario.yaml").with_({
        "chart": {"source": "raster", "file": str(chart), "no_go": "no_go.geojson"},
        "area": {"lower": [-4300, -4700, 0], "upper": [4800, 4500, 50]}, "current.forecast_error": 0.1,
    })  # fmt: skip
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


@launch()
def main() -> None:
    if not SHARED.is_dir():
        raise SystemExit(f"{SHARED}: no such folder")
    print(fjord(), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for line in islands(Path(folder)):
            print(line, flush=True)
