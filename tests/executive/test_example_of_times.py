"""The example of times, from its files to a checked plan and back."""

import pytest

from auvplan.check.run import check_run
from auvplan.executive import plan_scenario
from auvplan.io.example import write_example_of_times
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run
from auvplan.runtime.files import OutputError
from auvplan.scenario.file import load_scenario

pytestmark = pytest.mark.usefixtures("light_search")


@pytest.mark.slow
def test_the_example_is_planned_saved_checked_and_restored(tmp_path):
    folder = tmp_path / "tide"
    scenario, *_ = write_example_of_times(folder)
    with pytest.raises(OutputError, match="already exists"):
        write_example_of_times(folder)
    run = plan_scenario(load_scenario(scenario))
    assert run.success
    assert run.total_priority >= 22.0
    report = check_run(save_run(run, tmp_path / "out"))
    assert report.faults == []
    assert report.notes == []
    again = restore_run(tmp_path / "out")
    assert [one.spans for one in again.closures] == [one.spans for one in run.closures]
    assert again.graph.timetable.enters.shape == run.graph.timetable.enters.shape
