"""GeoPath as CDR: the same bytes as rosbags makes of the message, and places that come back."""

import numpy as np
import pytest

from auvplan.export.itinerary import waypoints
from auvplan.export.ros import TYPE, geo_path
from auvplan.site import as_utc
from tests.export.compare import azimuth
from tests.export.sample import make_itinerary

DEFINITIONS = {
    "geographic_msgs/msg/GeoPath": "std_msgs/Header header\ngeographic_msgs/GeoPoseStamped[] poses",
    "geographic_msgs/msg/GeoPoseStamped": "std_msgs/Header header\ngeographic_msgs/GeoPose pose",
    "geographic_msgs/msg/GeoPose": "geographic_msgs/GeoPoint position\ngeometry_msgs/Quaternion orientation",
    "geographic_msgs/msg/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude",
}


def test_rosbags_reads_places_and_times_and_writes_the_same_bytes():
    typesys = pytest.importorskip("rosbags.typesys", reason="needs rosbags: pip install rosbags")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(typesys.get_types_from_msg(text, name))
    itinerary = make_itinerary()
    raw = geo_path(itinerary)
    path = store.deserialize_cdr(raw, TYPE)
    assert bytes(store.serialize_cdr(path, TYPE)) == raw
    rows = waypoints(itinerary)
    assert len(path.poses) == len(rows)
    for pose, row in zip(path.poses, rows, strict=True):
        place, stamp = pose.pose.position, pose.header.stamp
        assert (place.latitude, place.longitude) == (row.latitude, row.longitude)
        assert place.altitude == pytest.approx(-row.depth)
        then = as_utc(itinerary.site.utc(row.seconds)).timestamp()
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(then, abs=1e-5)
    turn = path.poses[0].pose.orientation
    north, east, _ = rows[1].position - rows[0].position
    true = float(azimuth(itinerary, rows[0].position, np.arctan2(east, north)))
    assert 2.0 * np.arctan2(turn.z, turn.w) == pytest.approx(np.radians(90.0 - true))
