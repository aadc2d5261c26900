"""A made run and a made study, and their pages."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from auvplan.io import save_run
from auvplan.ocean.seabed import Seabed
from auvplan.report import write_report
from auvplan.runtime.files import write_dataset
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from auvplan.view.sheet import sheet_of
from tests.io.sample_run import make_run
from tests.plot.sample_study import make_study

#: A name that would end the script that it stands in.
HOSTILE = "</script><script>alert('x')</script> & \"bravo\" {{data}} \u2028"


def hostile_run():
    """Three legs with a site, a sea bed, a current that changes, and names that try to be markup."""
    run = make_run()
    run.scenario = Scenario.model_validate({"name": HOSTILE}).model_dump(mode="json")
    run.site = Site(148.96, -20.34, datetime(2026, 11, 22, 6, tzinfo=UTC), (1000.0, 1000.0))
    run.names = ["alpha", HOSTILE, "charlie <b>bold</b>", "delta"]
    for k, plan in enumerate(plan for leg in run.legs for plan in leg.plans):
        plan.current = replace(plan.current, strength=(1.0 - 0.3 * k) * plan.current.strength)
    slope = 120.0 - 0.03 * np.arange(40)[:, None] * 50.0 + np.zeros((40, 40))
    run.seabed = Seabed.from_depth(slope, 50.0, clearance=5.0)
    return run


def save(run, folder):
    """A run's files as the commands write them."""
    return save_run(run, folder, sheet=sheet_of(run).plain())


@pytest.fixture(scope="session")
def run():
    return hostile_run()


@pytest.fixture(scope="session")
def run_page(run, tmp_path_factory):
    """The page of the made run, beside its files."""
    return write_report(save(run, tmp_path_factory.mktemp("run")))


@pytest.fixture(scope="session")
def study_page(tmp_path_factory):
    """The page of a made study of 8 missions, of seeds from 3 on, that sweeps a setting over two values."""
    folder = tmp_path_factory.mktemp("study")
    study = make_study(8, {"vehicle.speed": [2.0, 2.5]}, first_seed=3)
    write_dataset(study.assign_attrs(scenario='{"name": "whitsunday"}'), folder / "missions.nc")
    for name in ("study.json", "summary.json"):
        (folder / name).write_text("{}")
    (folder / "runs" / "0001-00000004").mkdir(parents=True)
    (folder / "runs" / "0001-00000004" / "mission.nc").touch()
    return write_report(folder)
