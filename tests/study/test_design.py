"""What a study runs: sweeps as they are written, cases in order, plain data there and back."""

import contextlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.errors import ScenarioError
from auvplan.study import Design, StudyError, Sweep
from auvplan.study.design import by_case
from tests.executive.small import SMALL, scenario
from tests.tool import refused

RATES = Sweep("current.update_rate", (0.0, 0.5, 1.0))
REPLAN = Sweep("planning.replan", ("late", "deviation"))


@pytest.mark.parametrize(
    ("text", "field", "values"),
    [
        ("current.update_rate=0,0.5,1", "current.update_rate", (0, 0.5, 1)),
        ("planning.replan=late,deviation", "planning.replan", ("late", "deviation")),
        (" planning.t_series = 3 ", "planning.t_series", (3,)),
        ("planning.charge_compute=true, false", "planning.charge_compute", (True, False)),
        ("planning.objective=null,eq15", "planning.objective", (None, "eq15")),
        ("mission.start=[[0, 0, 5], [10, 0, 5]]", "mission.start", ([0, 0, 5], [10, 0, 5])),
        ("chart.image=a=b.png", "chart.image", ("a=b.png",)),
        ("simulation.obstacles.static=0,2", "simulation.obstacles.static", (0, 2)),
    ],
)
def test_a_sweep_is_read_as_it_is_written(text, field, values):
    sweep = Sweep.parse(text)
    assert sweep == Sweep(field, values)
    assert [type(value) for value in sweep.values] == [type(value) for value in values]
    assert sweep.dim == field.replace(".", "_")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "current.update_rate",
        "current.update_rate=",
        "current.update_rate= ",
        "current.update_rate=[]",
        "current.update_rate=[1, 2",
        "current.update_rate=1,{",
        "current.update_rate=[1],[2]",
        "update_rate=1,2",
        "=1,2",
        "..=0",
        ".b=1",
        "a.=1",
        "a. .b=1",
        "a.b=&x [1],*y",
        "a.b=!!python/object/apply:os.system ['true']",
        "a.b=1\n\0",
        "a.b=" + "[" * 5000,
    ],
)
def test_a_sweep_of_another_form_is_refused_in_one_line(text):
    with refused(StudyError, r"give it as section\.name=value,value"):
        Sweep.parse(text)


@pytest.mark.parametrize("values", ["1,2,1", "late, deviation, late", "[[0, 0, 5], [0, 0, 5]]"])
def test_a_value_given_twice_is_refused(values):
    with pytest.raises(StudyError, match="a value is given twice"):
        Sweep.parse(f"a.b={values}")


@given(st.lists(st.floats(0.0, 1e6) | st.integers(0, 10**6), min_size=1, unique=True))
def test_numbers_come_back_from_their_text(values):
    """As Python writes them, but for exponents, which YAML wants with a point."""
    text = ",".join(np.format_float_positional(v) if isinstance(v, float) else str(v) for v in values)
    assert Sweep.parse(f"a.b={text}").values == tuple(values)


@given(st.text() | st.text("ab.=,[]{}&*!'\"\\\n\0 1"))
def test_any_text_is_a_sweep_or_refused(text):
    with contextlib.suppress(StudyError):
        sweep = Sweep.parse(text)
        assert sweep.values
        section, *names = sweep.field.split(".")
        assert names
        assert all(name.strip() for name in (section, *names))


def test_cases_are_the_product_with_the_last_sweep_fastest():
    design = Design(scenario(), 2, sweeps=(REPLAN, RATES))
    found = [(case.planning.replan, case.current.update_rate) for case in design.cases]
    assert found == [(replan, rate) for replan in REPLAN.values for rate in RATES.values]
    assert design.shape == (2, 3)
    for case in design.cases:
        assert case.current.peak_speed == SMALL["current"]["peak_speed"]
        assert (case.area, case.mission, case.simulation) == (
            scenario().area, scenario().mission, scenario().simulation
        )  # fmt: skip


def test_without_a_sweep_there_is_one_case():
    design = Design(scenario(), 3, seed=40)
    assert design.cases == [scenario()]
    assert design.shape == ()
    assert design.tasks == [(0, 40), (0, 41), (0, 42)]


@given(count=st.integers(1, 9), seed=st.integers(0, 10**6), rates=st.integers(1, 4))
@settings(deadline=None)
def test_every_case_has_the_same_seeds(count, seed, rates):
    sweeps = (REPLAN, Sweep("current.update_rate", tuple(range(rates))))
    design = Design(scenario(), count, seed, sweeps)
    cases = by_case(design.tasks)
    assert list(cases) == list(range(len(design.cases)))
    assert all(seeds == list(range(seed, seed + count)) for seeds in cases.values())


@pytest.mark.parametrize(
    "field",
    [
        "current.speed",
        "current.update.rate",
        "weather.wind",
        "name.x",
        "current.",
        ".update_rate",
        "description.x",
    ],
)
def test_an_unknown_field_is_named(field):
    with pytest.raises(ScenarioError, match=rf"^sweep: {field.partition('.')[0]}[.\w]*: unknown key"):
        _ = Design(scenario(), 1, sweeps=(Sweep(field, (1, 2)),)).cases


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("vehicle.speed", (2, -1)),
        ("vehicle.speed", (2, "fast")),
        ("vehicle.speed", (float("nan"),)),
        ("planning.replan", ("late", "never")),
        ("mission.start", ([1, 2],)),
        ("simulation.obstacles.static", (1.5,)),
        ("current.update_rate", ({2: 3},)),
        ("current.update_rate", (None,)),
    ],
)
def test_a_value_that_does_not_fit_is_told_with_its_field(field, values):
    with refused(ScenarioError, f"^sweep: {field}"):
        _ = Design(scenario(), 1, sweeps=(Sweep(field, values),)).cases


def test_values_that_do_not_fit_together_are_stated():
    outside = Sweep("mission.start", ([1, 2, 3], [9000, 2, 3]))
    with pytest.raises(ScenarioError, match=r"mission\.start: .* outside the area"):
        _ = Design(scenario(), 1, sweeps=(outside,)).cases


def test_a_field_swept_twice_is_refused():
    sweeps = (Sweep("planning.replan", ("late",)), Sweep("planning.replan", ("deviation",)))
    with pytest.raises((StudyError, ScenarioError), match=r"planning\.replan"):
        _ = Design(scenario(), 1, sweeps=sweeps).cases


@given(
    count=st.integers(1, 10**6),
    seed=st.integers(0, 2**31 - 1),
    rates=st.lists(st.floats(0.0, 1e6) | st.integers(0, 9), min_size=1, unique=True),
    starts=st.lists(st.lists(st.floats(0.0, 50.0), min_size=3, max_size=3), min_size=1, unique_by=str),
    objectives=st.lists(st.sampled_from([None, "priority", "eq15"]), min_size=1, unique=True),
)
@settings(deadline=None)
def test_a_design_comes_back_from_json(count, seed, rates, starts, objectives):
    values = {"current.update_rate": rates, "mission.start": starts, "planning.objective": objectives}
    sweeps = tuple(Sweep(field, tuple(given)) for field, given in values.items())
    design = Design(scenario(), count, seed, sweeps)
    again = Design.of(json.loads(json.dumps(design.plain())))
    assert again == design
    assert again.plain() == design.plain()
    assert list(again.plain()["sweeps"]) == list(values)


def test_a_study_has_no_seeds_beyond_those_that_make_keys_of_their_own():
    assert Design(scenario(), 2, 2**32 - 2).seeds[-1] == 2**32 - 1
    for count, seed in ((2, 2**32 - 1), (1, 2**32), (3, -1)):
        with refused(StudyError, "a seed is from 0 to 4294967295"):
            Design(scenario(), count, seed)
