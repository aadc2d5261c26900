"""A study from design to dataset: files, figures, sweeps, what is refused, workers that fail."""

import gc
import json
import shutil
from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
import xarray as xr

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.io import load_run
from auvplan.runtime.files import ResultError, read_summary, write_dataset
from auvplan.scenario.scenario import Scenario
from auvplan.study import Design, StudyError, Sweep, load_study, run_study, summarise, without_clocks
from auvplan.study import runner as runner_module
from auvplan.study.store import Store
from auvplan.study.table import VARIABLES
from tests.study import dying, light
from tests.study.light import mission, small
from tests.tool import refused

pytestmark = pytest.mark.usefixtures("light_search", "executed")

run_here = partial(run_study, workers=1)

RESULTS = ["missions.nc", "study.json", "summary.json"]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def pieces(folder):
    return sorted(path.name for path in (folder / "missions").iterdir())


def break_off(design, out, after):
    """Begin a study, and stop it when so many missions are done."""

    def stop(done, total, share):
        if done == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_here(design, out, progress=stop)


def assert_same(first, second):
    xr.testing.assert_identical(without_clocks(first), without_clocks(second))


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """Missions that were executed once are taken from disk: most of what is tested happens after that."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(light.EXECUTED, light.cache_settings(tmp_path_factory)[light.EXECUTED])
        patch.setattr(runner_module, "run_job", light.run_job)
        yield


@pytest.fixture(scope="module")
def seven(light_search, executed, tmp_path_factory):
    """A study of seven missions: its folder, its dataset, and what its progress was given."""
    out, stated = tmp_path_factory.mktemp("seven") / "new" / "folder", []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner_module, "run_job", partial(light.run_job, anew=True))
        dataset = run_here(Design(small(), 7), out, progress=lambda *words: stated.append(words))
    return out, dataset, stated


@pytest.fixture(scope="module")
def three(light_search, executed, tmp_path_factory):
    """A study of three missions: its folder and its dataset."""
    out = tmp_path_factory.mktemp("three")
    return out, run_here(Design(small(), 3), out)


def test_a_study_leaves_its_design_its_dataset_and_its_summary(seven):
    out, dataset, _ = seven
    assert names(out) == RESULTS
    assert Design.of(json.loads((out / "study.json").read_text())) == Design(small(), 7)
    summary = read_summary(out)
    clock = summary.pop("clock")
    assert summary == json.loads(json.dumps(summarise(dataset), allow_nan=False))
    assert summary["missions"] == clock["missions"] == 7
    assert clock["workers"] == 1
    assert 0.0 <= clock["compile_s"] < clock["wall_s"]


def test_the_dataset_is_read_back_as_it_was_handed_over(seven):
    out, dataset, _ = seven
    xr.testing.assert_identical(load_study(out), dataset)
    with xr.open_dataset(out / "missions.nc") as opened:
        xr.testing.assert_identical(opened.load(), dataset)


def test_the_dataset_tells_what_it_holds(seven):
    _, dataset, _ = seven
    assert dataset.attrs["Conventions"].startswith("CF-")
    assert Scenario.model_validate(json.loads(dataset.attrs["scenario"])) == small()
    assert dataset.attrs["first_seed"] == 0
    assert dataset.attrs["missions"] == 7
    assert "small" in dataset.attrs["title"]
    assert "auvplan" in dataset.attrs["source"]
    assert set(dataset.data_vars) == set(VARIABLES)
    for name, variable in dataset.variables.items():
        assert variable.attrs["long_name"], name
        assert variable.dims[0] == "mission", name
        if variable.dtype.kind == "f":
            assert variable.attrs["units"] in ("s", "m", "1"), name
        if "flag_values" in variable.attrs:
            meanings = variable.attrs["flag_meanings"].split()
            assert variable.attrs["flag_values"].tolist() == list(range(len(meanings)))
            assert variable.attrs["flag_values"].dtype == variable.dtype
            assert set(np.unique(variable)) <= {-1, *range(len(meanings))}
    clocks = [name for name in VARIABLES if "wall-clock" in dataset[name].attrs.get("comment", "")]
    assert sorted(set(dataset) - set(without_clocks(dataset))) == sorted(clocks)
    assert "t_mission" not in clocks
    assert "plan_cpu" in clocks


def test_figures_of_a_mission_fit_together(seven):
    _, dataset, _ = seven
    np.testing.assert_array_equal(dataset["t_residual"], dataset["t_available"] - dataset["t_mission"])
    np.testing.assert_array_equal(dataset["seed"], range(7))
    assert (dataset["success"] == 1).all()
    assert (dataset["reason"] == "destination reached in time").all()
    arrived = dataset["leg_arrived"] == 1
    done = dataset.where(arrived)
    whole = (done["leg_t_path"] + done["leg_t_task"]).sum("leg")
    np.testing.assert_allclose(dataset["t_mission"], whole, atol=0.1)
    again = (dataset["plan_cause"] > 1).sum("plan")
    np.testing.assert_array_equal(dataset["leg_path_replans"].where(lambda x: x >= 0).sum("leg"), again)
    for name, figure in {
        "tasks": (done["leg_priority"] > 0).sum("leg"),
        "total_priority": done["leg_priority"].sum("leg"),
        "path_calls": (dataset["leg_from"] >= 0).sum("leg"),
        "path_replans": again,
        "mission_replans": (dataset["route_cause"] > 1).sum("route"),
    }.items():
        np.testing.assert_array_equal(dataset[name], figure, name)
    for name, parts in (("path_cpu", "leg"), ("path_cpu", "plan"), ("mission_cpu", "route")):
        np.testing.assert_allclose(dataset[name], dataset[f"{parts}_cpu"].sum(parts))
    assert (dataset["coast_clearance"] == np.inf).all(), "there is no coast"
    assert (dataset["collisions"] == 0).all()
    assert (dataset["faults"] == 0).all()
    assert (dataset["length"] >= done["leg_distance"].sum("leg") - 1.0).all()


@pytest.mark.parametrize(
    ("dim", "there"), [("leg", "leg_from"), ("plan", "plan_leg"), ("route", "route_nodes")]
)
def test_what_a_mission_lacks_is_padded(seven, dim, there):
    _, dataset, _ = seven
    found = dataset[there].values >= 0
    found = found.any(axis=-1) if dim == "route" else found
    assert found.any(axis=0).all(), "padded to the longest and no further"
    assert not found.all()
    assert (np.diff(found.astype(int), axis=1) <= 0).all(), "padding comes last"
    for name, variable in dataset.data_vars.items():
        if variable.dims != ("mission", dim):
            continue
        filled, padded = variable.values[found], variable.values[~found]
        if variable.dtype.kind == "f":
            assert np.isfinite(filled).all(), name
            assert np.isnan(padded).all(), name
        else:
            fill = 0 if name.endswith("_cause") else -1
            assert (padded == fill).all(), name
            assert (filled > fill).all(), name


def test_figures_are_those_of_the_missions_executed_directly(three):
    _, dataset = three
    seeds = [0, 1, 2]
    runs = ap.run_missions(small(), keys=jax.vmap(jax.random.key)(np.arange(3)), seeds=seeds)
    for run, seed in zip(runs, seeds, strict=True):
        one, summary = mission(dataset, seed).isel(mission=0), run.summary()
        for name in (
            "t_available", "t_mission", "t_residual", "success", "reason", "tasks", "collisions",
            "total_priority", "path_calls", "path_replans", "mission_replans", "cost_mission",
        ):  # fmt: skip
            assert one[name] == summary[name], name
        plans = [(k, plan) for k, leg in enumerate(run.legs) for plan in leg.plans]
        for name, values in {
            "leg_from": [leg.start for leg in run.legs],
            "leg_to": [leg.goal for leg in run.legs],
            **{f"leg_{name}": [getattr(leg, name) for leg in run.legs]
               for name in ("t_expected", "t_path", "t_task", "priority", "arrived")},
            **{f"route_{name}": [getattr(route, name) for route in run.routes]
               for name in ("made_at", "time", "priority")},
            "plan_cost": [plan.cost for _, plan in plans],
            "plan_leg": [k for k, _ in plans],
            "waypoint_position": run.graph.positions,
        }.items():  # fmt: skip
            np.testing.assert_array_equal(one[name], values, name)
        for kind, made in (("route", run.routes), ("plan", [plan for _, plan in plans])):
            codes = one[f"{kind}_cause"]
            meanings = np.array(codes.attrs["flag_meanings"].split())
            assert meanings[codes].tolist() == [each.cause for each in made]
        for row, route in zip(one["route_nodes"].values, run.routes, strict=True):
            assert row[row >= 0].tolist() == list(route.nodes)


def test_a_mission_is_the_same_to_the_last_bit_in_batches_of_1_3_and_7(seven, tmp_path, monkeypatch):
    monkeypatch.setattr(runner_module, "run_job", partial(light.run_job, anew=True))
    batches = [seven[1]]
    batches += [run_here(Design(small(), n, seed), tmp_path / str(n)) for n, seed in ((1, 3), (3, 2))]
    first, *others = (mission(batch, 3) for batch in batches)
    assert first["path_replans"] > 0, "a mission that says little"
    for other in others:
        xr.testing.assert_identical(first, other)


@pytest.mark.slow
def test_a_sweep_adds_dimensions_and_its_cases_are_the_single_studies(tmp_path):
    sweeps = (Sweep.parse("planning.replan=late,deviation"), Sweep.parse("current.update_rate=0,1"))
    # By edges: where no waypoint may be visited again, small missions have one route left for either rule.
    base = small(planning={"visits": "edges"})
    dataset = run_here(Design(base, 2, seed=5, sweeps=sweeps), tmp_path / "swept")
    xr.testing.assert_identical(dataset, load_study(tmp_path / "swept"))
    assert dataset["t_mission"].dims == ("planning_replan", "current_update_rate", "mission")
    assert dataset["seed"].dims == ("mission",)
    assert dataset.attrs["sweep"] == "planning_replan,current_update_rate"
    assert dataset["planning_replan"].attrs["field"] == "planning.replan"
    assert dataset["planning_replan"].values.tolist() == ["late", "deviation"]
    assert dataset["current_update_rate"].values.tolist() == [0.0, 1.0]
    assert dataset["current_update_rate"].dtype == float
    # Seeds are paired: all cases have the same worlds.
    places = dataset["waypoint_position"]
    assert (places == places[0, 0]).all()
    settled = []
    for replan in ("late", "deviation"):
        for rate in (0.0, 1.0):
            one = small(planning={"visits": "edges", "replan": replan}, current={"update_rate": rate})
            alone = run_here(Design(one, 2, seed=5), tmp_path / f"{replan}{rate}")
            case = dataset.sel(planning_replan=replan, current_update_rate=rate)
            case = case.drop_vars(["planning_replan", "current_update_rate"])
            for seed in (5, 6):
                xr.testing.assert_identical(mission(case, seed), mission(alone, seed))
            settled.append(tuple(alone["t_mission"].values))
    assert len(set(settled)) > 2, "settings that change nothing show nothing"
    cases = read_summary(tmp_path / "swept")["cases"]
    assert [case["setting"] for case in cases] == [
        {"planning.replan": replan, "current.update_rate": rate}
        for replan in ("late", "deviation")
        for rate in (0, 1)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("planning.charge_compute=true,false", ["True", "False"]),
        ("mission.start=[[100, 100, 5], [200, 100, 5]]", ["[100, 100, 5]", "[200, 100, 5]"]),
    ],
)
def test_values_of_a_sweep_are_a_coordinate(tmp_path, text, values):
    hasty = small(mission={"time_available": 60})  # over before it begins
    dataset = run_here(Design(hasty, 1, sweeps=(Sweep.parse(text),)), tmp_path)
    dim = dataset.attrs["sweep"]
    assert dataset[dim].values.tolist() == values
    xr.testing.assert_identical(load_study(tmp_path), dataset)


def test_progress_ends_with_everything_done(seven):
    _, _, stated = seven
    done, totals, shares = zip(*stated, strict=True)
    assert stated[-1] == (7, 7, 1.0)
    assert set(totals) == {7}
    assert list(done) == sorted(done)
    assert set(done) >= set(range(1, 8))
    assert min(shares) >= 0.0
    assert max(shares) == 1.0


@pytest.mark.slow
def test_whole_results_are_saved_when_asked_for(three, tmp_path):
    _, dataset = three
    run_here(Design(small(), 2), tmp_path, save_runs=True)
    assert names(tmp_path) == sorted([*RESULTS, "runs"])
    assert names(tmp_path / "runs") == ["0000-00000000", "0000-00000001"]
    for seed in (0, 1):
        folder = tmp_path / "runs" / f"0000-{seed:08d}"
        assert read_summary(folder)["t_mission"] == float(dataset["t_mission"][seed])
        assert load_run(folder).attrs["title"].endswith(f"seed {seed}")


def test_missions_that_end_before_they_begin_are_rows_too(tmp_path):
    hasty = small(mission={"time_available": 60})
    dataset = run_here(Design(hasty, 2), tmp_path)
    xr.testing.assert_identical(load_study(tmp_path), dataset)
    assert (dataset["success"] == 0).all()
    assert dataset.sizes["leg"] == dataset.sizes["plan"] == 0
    for name in ("total_priority", "path_cpu", "mission_cpu", "travel_time_cpu", "length"):
        assert dataset[name].dtype == float, name
    assert (dataset["total_priority"] == 0.0).all()
    summary = read_summary(tmp_path)
    assert summary["failed_seeds"] == [0, 1]
    assert all("time" in reason for reason in summary["failures"])
    json.dumps(summary, allow_nan=False)


def test_an_unfinished_study_is_resumed_where_that_is_asked_for_and_ends_the_same(three, tmp_path):
    design, stated = Design(small(), 3), []
    break_off(design, tmp_path, after=1)
    before = pieces(tmp_path)
    assert len(before) == 1
    # What a killed writer leaves is no mission.
    (tmp_path / "missions" / ".0000-00000002-0123456789ab.npz").write_bytes(b"half")
    with refused(StudyError, r"unfinished study, 1 mission done: .*--resume"):
        run_here(design, tmp_path)
    assert [name for name in pieces(tmp_path) if not name.startswith(".")] == before
    dataset = run_here(design, tmp_path, resume=True, progress=lambda *words: stated.append(words))
    assert_same(dataset, three[1])
    assert names(tmp_path) == RESULTS
    assert read_summary(tmp_path)["clock"]["missions"] == 2
    assert stated[0][:2] in ((1, 3), (2, 3))
    assert stated[-1] == (3, 3, 1.0)


def test_a_study_broken_off_over_its_results_is_resumed(three, tmp_path, monkeypatch):
    """All missions are on disk, the dataset or the summary is not."""
    design = Design(small(), 3)
    for step in ("table", "summarise"):
        out = tmp_path / step
        with monkeypatch.context() as patch:
            patch.setattr(runner_module, step, stop_here)
            with pytest.raises(KeyboardInterrupt):
                run_here(design, out)
        with monkeypatch.context() as patch:
            patch.setattr(runner_module, "run_job", stop_here)
            assert_same(run_here(design, out, resume=True), three[1])
        assert names(out) == RESULTS


def stop_here(*_, **__):
    raise KeyboardInterrupt


def test_a_study_broken_off_while_its_folder_was_made_can_be_begun(three, tmp_path, monkeypatch):
    design = Design(small(), 3)
    with monkeypatch.context() as patch:
        patch.setattr("auvplan.study.store.files.write_json", stop_here)
        with pytest.raises(KeyboardInterrupt):
            run_here(design, tmp_path)
    assert_same(run_here(design, tmp_path), three[1])


def test_a_finished_study_is_resumed_without_running(three, tmp_path, monkeypatch):
    out, dataset = three
    written = {name: (out / name).read_bytes() for name in RESULTS}
    monkeypatch.setattr(runner_module, "run_job", stop_here)
    xr.testing.assert_identical(run_here(Design(small(), 3), out, resume=True), dataset)
    assert {name: (out / name).read_bytes() for name in names(out)} == written


@pytest.mark.parametrize(
    "sweeps", [(), pytest.param((Sweep("planning.replan", ("late", "deviation")),), marks=pytest.mark.slow)]
)
def test_a_study_is_extended_and_ends_as_one_of_all_its_missions(tmp_path, sweeps):
    """Finished or not, and broken off at any step on the way."""
    wanted = Design(small(), 3, sweeps=sweeps)
    whole = run_here(wanted, tmp_path / "whole")
    for name, begin in (("finished", run_here), ("unfinished", partial(break_off, after=1))):
        out = tmp_path / name
        begin(replace(wanted, count=2), out)
        with pytest.raises(KeyboardInterrupt):
            run_here(wanted, out, resume=True, progress=stop_here)
        assert_same(run_here(wanted, out, resume=True), whole)
        assert names(out) == RESULTS


@pytest.mark.slow
def test_a_study_that_lacks_a_variable_is_shown_but_not_extended(three, tmp_path):
    """One that neither its summary nor its pictures need."""
    out = tmp_path / "older"
    shutil.copytree(three[0], out)
    lacking = load_study(out).drop_vars("revisits")
    (out / "missions.nc").unlink()
    write_dataset(lacking, out / "missions.nc")
    assert "revisits" not in load_study(out)
    with pytest.raises(ResultError, match="no variable revisits, and cannot be extended"):
        run_here(Design(small(), 4), out, resume=True)
    assert load_study(out)["success"].size == 3


def test_missions_left_beside_finished_results_go_when_it_is_resumed(tmp_path):
    """A study broken off while it cleaned up."""
    design = Design(small(), 1)
    dataset = run_here(design, tmp_path)
    (tmp_path / "missions").mkdir()
    (tmp_path / "missions" / "0000-00000000.npz").write_bytes(b"")
    xr.testing.assert_identical(run_here(design, tmp_path, resume=True), dataset)
    assert names(tmp_path) == RESULTS


@pytest.mark.slow
def test_a_finished_study_makes_way_for_another_one_by_force_alone(tmp_path):
    first = run_here(Design(small(), 2), tmp_path, save_runs=True)
    with refused(StudyError, r"finished study of 2 missions: .*--resume.*--force"):
        run_here(Design(small(), 1, seed=9), tmp_path)
    xr.testing.assert_identical(load_study(tmp_path), first)
    dataset = run_here(Design(small(), 1, seed=9), tmp_path, force=True)
    xr.testing.assert_identical(load_study(tmp_path), dataset)
    assert dataset["seed"].values.tolist() == [9]
    assert names(tmp_path) == RESULTS


@pytest.mark.parametrize("count", [3, 4])
def test_a_study_is_not_resumed_to_save_runs_where_missions_are_done_without(three, tmp_path, count):
    """Neither a finished one, whole or as a part, nor one that was broken off; nothing is changed."""
    out = tmp_path / "study"
    shutil.copytree(three[0], out)
    words = r"study: 3 finished missions without a saved run: resume it without --save-runs, or .*--force"
    with refused(StudyError, words):
        run_here(Design(small(), count), out, resume=True, save_runs=True)
    assert names(out) == names(three[0])
    for seed in range(3):
        (out / "runs" / f"0000-{seed:08d}").mkdir(parents=True)
    design = Design(small(), 3)
    xr.testing.assert_identical(run_here(design, out, resume=True, save_runs=True), three[1])
    (out / "runs" / "0000-00000001").rmdir()
    with refused(StudyError, "1 finished mission without"):
        Store(out, Design(small(), 4), resume=True, save_runs=True)
    Store(out, Design(small(), 4), resume=True)
    with refused(StudyError, "1 finished mission without"):
        Store(out, Design(small(), 4), resume=True, save_runs=True)
    (out / "missions" / "0000-00000001.npz").unlink()
    assert Store(out, Design(small(), 4), resume=True, save_runs=True).missing() == [(0, 1), (0, 3)]


@pytest.mark.parametrize(
    ("other", "field"),
    [
        (Design(small(), 2), "count"),
        (Design(small(), 3, seed=1), "seed"),
        (Design(small(planning={"replan": "late"}), 3), "scenario.planning"),
        (Design(small(), 3, sweeps=(Sweep("planning.replan", ("late",)),)), "sweeps.planning.replan"),
    ],
)
def test_another_study_is_not_resumed(three, other, field):
    out, dataset = three
    with refused(StudyError, rf"study\.json: {field} differs"):
        run_here(other, out, resume=True)
    xr.testing.assert_identical(load_study(out), dataset)


REPLAN, RATE = Sweep("planning.replan", ("late", "deviation")), Sweep("current.update_rate", (0, 1))


def test_other_sweeps_or_another_order_of_them_make_another_study(tmp_path):
    """The dataset's dimensions and the numbers of its cases follow the order."""
    break_off(Design(small(), 1, sweeps=(REPLAN, RATE)), tmp_path, after=1)
    for other in ((), (RATE, REPLAN)):
        with refused(StudyError, r"sweeps.* differs"):
            run_here(Design(small(), 1, sweeps=other), tmp_path, resume=True)


def test_nothing_is_resumed_where_there_is_no_study(tmp_path):
    with pytest.raises(StudyError, match=r"study\.json: no study to resume"):
        run_here(Design(small(), 1), tmp_path / "nothing", resume=True)
    assert not (tmp_path / "nothing").exists()
    for text in ("{", "[]", "null", '{"count": 1}', "[" * 100_000, '{"count": ' + "9" * 9999 + "}"):
        (tmp_path / "study.json").write_text(text)
        with refused(StudyError, r"study\.json: "):
            run_here(Design(small(), 1), tmp_path, resume=True)


def test_a_damaged_mission_is_named(three, tmp_path):
    design = Design(small(), 3)
    break_off(design, tmp_path, after=3)
    piece = tmp_path / "missions" / "0000-00000001.npz"
    whole = piece.read_bytes()
    for kept in (0.0, 0.5, 0.99):
        piece.write_bytes(whole[: int(kept * len(whole))])
        with refused(ResultError, r"0000-00000001\.npz: not a readable mission .*--resume"):
            run_here(design, tmp_path, resume=True)
    piece.unlink()
    assert_same(run_here(design, tmp_path, resume=True), three[1])
    # A file that stayed open would warn only now, and fail this test.
    gc.collect()


NO_PICTURE = small(chart={"source": "image", "image": "missing.png"})
COAST = small(chart={"source": "whitsunday"}, area={"upper": (10e3, 10e3, 50)})


@pytest.mark.parametrize(
    ("bad", "sweeps", "reason"),
    [
        (NO_PICTURE, (), "missing.png"),
        (small(), (Sweep("vehicle.speed", (2.5, -1)),), "vehicle.speed"),
        (small(), (Sweep("vehicle.wings", (1, 2)),), "vehicle.wings: unknown key"),
        (COAST, (Sweep("area.upper", ([4e3, 4e3, 50.0], [4e4, 4e3, 50.0])),), "beyond the chart"),
        (COAST, (Sweep("mission.start", ([8000.0, 6500.0, 10.0],)),), "land"),
    ],
    ids=["no picture", "value", "field", "swept area", "start on land"],
)
def test_what_cannot_be_built_writes_nothing(tmp_path, bad, sweeps, reason):
    with refused(ValueError, reason):
        run_here(Design(bad, 2, sweeps=sweeps), tmp_path / "out", folder=tmp_path)
    assert not (tmp_path / "out").exists()


WORDS = "a worker process died.*--resume"


@pytest.mark.parametrize(
    ("work", "error", "words"),
    [
        (dying.work_and_die, StudyError, WORDS),
        (dying.work_and_die_speaking, StudyError, WORDS),
        pytest.param(light.work_and_fail, ScenarioError, "lies on land", marks=pytest.mark.slow),
    ],
)
def test_what_ends_a_worker_is_stated_and_the_study_can_be_resumed(
    three, tmp_path, monkeypatch, work, error, words
):
    design = Design(small(), 3)
    break_off(design, tmp_path, after=1)
    monkeypatch.setattr(runner_module, "work", work)
    with refused(error, words):
        run_study(design, tmp_path, workers=2, resume=True)
    assert len(pieces(tmp_path)) == 1
    assert_same(run_here(design, tmp_path, resume=True), three[1])


def test_a_study_is_not_resumed_with_other_files_than_it_was_begun_with(tmp_path):
    site = {"longitude": 5.0, "latitude": 60.0}
    jobs = {"jobs": "jobs.csv", "start": [0, 0, 5], "goal": [900, 0, 5], "time_available": 2000}
    design = Design(Scenario.model_validate({"name": "jobs", "site": site, "mission": jobs}), 3)
    (tmp_path / "jobs.csv").write_text("name,north,east,depth\nlander,100,50,5\n")
    begun = Store(tmp_path / "out", design, home=tmp_path)
    assert len(begun.missing()) == 3
    longer = replace(design, count=5)
    assert len(Store(tmp_path / "out", longer, resume=True, home=tmp_path).missing()) == 5
    (tmp_path / "jobs.csv").write_text("name,north,east,depth\nlander,100,60,5\n")
    with pytest.raises(StudyError, match=r"mission\.jobs: jobs\.csv was \w+, and is \w+ now; run it in"):
        Store(tmp_path / "out", longer, resume=True, home=tmp_path)
    # What is known of older studies is their settings alone.
    design_file = tmp_path / "out" / "study.json"
    plain = json.loads(design_file.read_text())
    del plain["sources"]
    design_file.write_text(json.dumps(plain))
    assert len(Store(tmp_path / "out", longer, resume=True, home=tmp_path).missing()) == 5
