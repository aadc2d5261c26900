"""Uploads: steps with the lines that lead there, and what is left of them on the way."""

from dataclasses import replace

import numpy as np
import pytest

from auvplan.errors import AuvplanError
from auvplan.export.itinerary import waypoints
from auvplan.export.qgroundcontrol import item_speeds
from auvplan.link import Limits, Upload
from auvplan.link.opening import check_address
from auvplan.link.progress import Pace, Progress
from tests.export.sample import SPEED, at_speeds, make_itinerary


def test_steps_are_the_waypoints_of_the_files(upload):
    rows = waypoints(upload.itinerary)
    assert [step.name for step in upload.steps] == [row.name for row in rows]
    assert [step.hold for step in upload.steps] == [0.0, 0.0, 0.0, 45.5, 0.0]
    assert [step.ends_leg for step in upload.steps] == [False, False, False, True, True]
    for before, step in zip(upload.steps, upload.steps[1:], strict=False):
        assert step.left == pytest.approx(before.position)
        assert before.time <= step.left_at <= step.time


@pytest.mark.parametrize("done", range(5))
def test_what_is_left_keeps_places_times_and_the_line_that_is_gone(upload, done):
    rest = upload.without(done)
    assert len(rest.steps) == len(upload.steps) - done
    for mine, whole in zip(rest.steps, upload.steps[done:], strict=True):
        assert mine.position == pytest.approx(whole.position)
        assert mine.left == pytest.approx(whole.left)
        assert (mine.leg, mine.hold, mine.ends_leg) == (whole.leg, whole.hold, whole.ends_leg)
        assert [mine.time, mine.left_at] == pytest.approx([whole.time, whole.left_at])
    for leg in rest.itinerary.legs:
        assert np.all(np.diff(leg.kept) > 0)
        assert len(leg.kept) == len(leg.kept_times)


@pytest.mark.parametrize("done", range(5))
def test_what_is_left_is_gone_at_the_speeds_of_the_whole(done):
    whole = Upload(make_itinerary(over_ground=True))
    speeds, rest = item_speeds(whole.itinerary), item_speeds(whole.without(done).itinerary)
    made = [step.pace for step in whole.steps]
    assert made[0] == 1.75
    assert speeds[0] == 1.75
    for found, step in zip(rest, whole.steps[done:], strict=True):
        assert found == pytest.approx(step.pace, rel=0.06)


def test_the_last_step_stays(upload):
    assert len(upload.without(99).steps) == 1


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("boat", "must be sim, mavlink:ADDRESS or imc:HOST:PORT"),
        ("mavlink:", "a MAVLink address is such as"),
        ("mavlink:udpin:14550", "a MAVLink address is such as"),
        ("imc:host", "an IMC address is such as"),
        ("imc:host:port", "an IMC address is such as"),
        ("imc:127.0.0.1:99999", "a port is from 1 to 65535"),
        ("mavlink:udpin:0.0.0.0:0", "a port is from 1 to 65535"),
        ("mavlink:udpout:no-such-host.invalid:14550", "host no-such-host.invalid: "),
    ],
)
def test_addresses_that_are_none(address, words):
    with pytest.raises(AuvplanError, match=r"^--link ") as error:
        check_address(address)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_limits_are_positive():
    with pytest.raises(AuvplanError, match="limit silence: must be positive, got 0"):
        Limits(silence=0)


def test_the_track_ahead_is_gone_at_the_pace_of_each_line():
    """Within the next three minutes, from a step that lies in its place on."""
    upload = Upload(make_itinerary())
    first, second = upload.steps[1:3]
    assert first.pace != pytest.approx(second.pace, rel=0.01)
    place = first.left + 0.8 * (first.position - first.left)
    track, seconds = Progress(upload, ahead=1).track_ahead(place, 0.0)
    corner = 0.2 * (first.time - first.left_at)
    assert seconds == pytest.approx([0.0, corner, 180.0])
    share = (180.0 - corner) / (second.time - second.left_at)
    assert track[-1] == pytest.approx(second.left + share * (second.position - second.left))
    track, seconds = Progress(upload).track_ahead(upload.steps[0].position, 0.0)
    assert seconds == pytest.approx([0.0, 0.0, 180.0])
    share = 180.0 / (first.time - first.left_at)
    assert track[-1] == pytest.approx(first.left + share * (first.position - first.left))


def under_way(upload, pace, until, every=5.0, stands=()):
    """Progress of a vehicle that goes all but the last step of an upload's first leg at a share of its pace.

    It is seen every so many s of the plan, and stands still for 100 s where `stands` says.
    """
    progress, now, first = Progress(upload, ahead=1), upload.steps[1].left_at, upload.steps[1].left_at
    for planned in np.arange(first, until, every):
        while upload.steps[progress.ahead].time < planned:
            progress.ahead += 1
        step = progress.step
        share = (planned - step.left_at) / (step.time - step.left_at)
        place = step.left + share * (step.position - step.left)
        for still in np.arange(0.0, 100.0 if planned in stands else 1.0, every):
            progress.time_pace(place, now + still)
        now += every / pace + (100.0 if planned in stands else 0.0)
    return progress


@pytest.mark.parametrize("pace", [0.5, 0.7, 0.9, 1.0, 1.2])
def test_the_pace_is_what_was_planned_for_the_way_made_by_what_it_took(upload, pace):
    """From 30 s at the full pace on; 1/e is kept after 20 and 3 minutes, and currents make a little of it."""
    first = upload.steps[1].left_at
    until = max(step.time for step in upload.steps if step.leg == 1) - 10.0
    progress = under_way(upload, pace, until)
    planned, taken = progress.pace.planned, progress.pace.taken
    memory = np.asarray([1200.0, 180.0])
    kept = np.exp(-(until - first) / pace / memory)
    begun, seen = 30.0 * kept, memory * (1.0 - kept)
    assert planned / taken == pytest.approx((begun + pace * seen) / (begun + seen), rel=0.02)
    slow = (planned / taken)[(planned / taken < 0.95) & (taken - planned > [45.0, 30.0])]
    assert progress.pace.share == (min(slow) if len(slow) else 1.0)
    assert progress.slower == pytest.approx(1.0 / progress.pace.share)
    # What the plan reckons with already is not slower than that.
    progress.counted = progress.pace.share
    assert progress.slower == pytest.approx(1.0)
    _, seconds = progress.track_ahead(progress.step.left, 0.0)
    progress.counted = 1.0
    _, later = progress.track_ahead(progress.step.left, 0.0)
    assert later[1] == pytest.approx(min(seconds[1] / progress.pace.share, 180.0), rel=1e-6)


def test_a_vehicle_that_grows_slow_is_known_to_be_within_minutes():
    pace = Pace()
    for _ in range(40):
        pace = pace.after(30.0, 30.0)
    assert pace.share == 1.0
    for _ in range(4):
        pace = pace.after(0.6 * 30.0, 30.0)
    assert 0.6 < pace.share < 0.85
    for _ in range(12):
        pace = pace.after(0.6 * 30.0, 30.0)
    assert pace.share == pytest.approx(0.64, abs=0.03)


def test_a_vehicle_that_stands_still_has_no_other_pace(upload):
    first = upload.steps[1].left_at
    until = max(step.time for step in upload.steps if step.leg == 1) - 10.0
    progress = under_way(upload, 1.0, until, stands=(first + 50.0, first + 100.0))
    assert progress.pace.share == 1.0


def test_a_vehicle_that_is_put_back_has_no_other_pace(upload):
    """As by a restart, which leaves it at the beginning of its leg."""
    first = upload.steps[1].left_at
    until = max(step.time for step in upload.steps if step.leg == 1) - 10.0
    progress = under_way(upload, 1.0, until)
    step, now = progress.step, until + 20.0
    for planned in np.arange(step.left_at, step.time, 5.0):
        share = (planned - step.left_at) / (step.time - step.left_at)
        progress.time_pace(step.left + share * (step.position - step.left), now + planned - step.left_at)
    assert until - first > 60.0
    assert progress.pace.share == 1.0


def test_at_a_task_the_track_ahead_stays_for_what_is_left_of_it(upload):
    progress = Progress(upload)
    ahead = next(k for k, step in enumerate(upload.steps) if step.hold > 0.0)
    progress.ahead, task = ahead, upload.steps[ahead]
    near = task.position + np.array([3.0, 0.0, 0.0])
    for since in (0.0, 0.25, 0.9):
        track, seconds = progress.track_ahead(near, 700.0 + since * task.hold)
        assert (track == task.position).all()
        begun = 30.0 / task.pace  # which it may begin when it is at rest there
        assert seconds[-1] == pytest.approx(min((1.0 - since) * task.hold + begun, 180.0))


def test_the_speeds_of_legs_are_those_of_their_steps():
    upload = Upload(replace(at_speeds((0.0, 0.0, 0.0)), over_ground=False))
    assert [step.speed for step in upload.steps] == [0.9] * 3 + [SPEED] + [1.5] * 2
    assert [step.pace for step in upload.steps] == pytest.approx([step.speed for step in upload.steps])
    for done in range(6):
        rest = upload.without(done)
        assert [step.speed for step in rest.steps] == [step.speed for step in upload.steps[done:]]
        assert item_speeds(rest.itinerary) == [step.speed for step in upload.steps[done:]]
    # To the start it goes at the speed of the first leg.
    start = upload.steps[0].position
    assert Progress(upload).late(start - [90.0, 0.0, 0.0], 0.0) == pytest.approx(90.0 / 0.9)
