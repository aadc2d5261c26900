"""MAVLink on loopback: MAVSDK's autopilot side and its reader of plans, through a link that loses packets."""

import json
import math
import subprocess
import sys
from functools import partial

import pytest

from auvplan.export import export
from auvplan.export.qgroundcontrol import qgc_plan
from auvplan.link import Limits, Refused

mavsdk = pytest.importorskip("mavsdk", reason="needs MAVSDK: pip install mavsdk")
pytest.importorskip("pymavlink", reason="needs pymavlink: pip install 'auvplan[link]'")

from tests.link.conftest import FAST  # noqa: E402
from tests.link.joining import CLEAN, Faults, followed, free_port, held_as_planned  # noqa: E402

LIMITS = Limits(reply=0.15, attempts=20, uploads=8, connect=5.0, outdated=0.2)


@pytest.fixture
def join(join_vehicle):
    return partial(join_vehicle, kind="mavlink", limits=LIMITS)


@pytest.mark.parametrize("faults", [pytest.param(CLEAN, marks=pytest.mark.slow), Faults()])
def test_items_and_fence_arrive_as_planned_and_are_executed(upload, join, faults):
    link, peer, _ = join(faults, scale=FAST)
    assert link.upload(upload) == []
    assert held_as_planned("mavlink", peer, upload)
    assert [item.command for item in peer.fences[-1]] == [5002] * 7 + [5004]
    link.start()
    report = followed(link, len(upload.steps))
    assert len(peer.tasks) == 1
    assert report.position is not None


def test_mavsdk_reads_the_plan_file_as_what_is_uploaded(upload, join, tmp_path):
    link, peer, _ = join()
    link.upload(upload)
    (path,) = export(upload.itinerary, tmp_path, ["qgc"])
    code = f"""
import json, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
ground = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
ground.add_any_connection("udpin://127.0.0.1:{(port := free_port())}")
vehicle = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
vehicle.add_any_connection("udpout://127.0.0.1:{port}")
vehicle.server_component()
found = MissionRaw(ground.first_autopilot(10.0)).import_qgroundcontrol_mission({str(path)!r})
found = found[-1] if isinstance(found, tuple) else found
names = ("frame", "command", "param1", "param2", "param3", "param4", "x", "y", "z")
rows = [[getattr(item, name) for name in names] for item in found.mission_items]
fence = [[getattr(item, name) for name in names] for item in found.geofence_items]
print(json.dumps([rows, fence]), flush=True)
import os
os._exit(0)
"""
    items, fence = json.loads(_output_of(code))
    for mine, theirs in ((peer.missions[-1], items), (peer.fences[-1], fence)):
        assert len(mine) == len(theirs)
        for item, row in zip(mine, theirs, strict=True):
            params = (item.param1, item.param2, item.param3, item.param4)
            assert [item.command, item.x, item.y] == [row[1], *row[6:8]]
            for ours, other in zip((*params, item.z), (*row[2:6], row[8]), strict=True):
                assert ours == pytest.approx(other, abs=1e-3, nan_ok=True) or math.isnan(ours)
    assert len(items) == len(qgc_plan(upload.itinerary)["mission"]["items"])


def _output_of(code: str) -> str:
    """Last line that a program of its own prints: one process is the vehicle of the link."""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.strip(), done.stderr
    return done.stdout.strip().splitlines()[-1]


def test_a_vehicle_that_refuses_is_told_of(upload, join):
    link, peer, _ = join()
    link.upload(upload)
    peer.refuse.add(300)
    with pytest.raises(Refused, match="command 300: denied"):
        link.start()
