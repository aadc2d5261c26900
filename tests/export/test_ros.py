"""GeoPath as CDR: the same bytes as two libraries make of the message, and places that come back."""

from dataclasses import dataclass

import numpy as np
import pytest

from auvplan.export import write_ros
from auvplan.export.itinerary import waypoints
from auvplan.export.ros import TYPE, geo_path
from auvplan.site import as_utc
from tests.export.sample import make_itinerary

DEFINITIONS = {
    "geographic_msgs/msg/GeoPath": "std_msgs/Header header\ngeographic_msgs/GeoPoseStamped[] poses",
    "geographic_msgs/msg/GeoPoseStamped": "std_msgs/Header header\ngeographic_msgs/GeoPose pose",
    "geographic_msgs/msg/GeoPose": "geographic_msgs/GeoPoint position\ngeometry_msgs/Quaternion orientation",
    "geographic_msgs/msg/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude",
}


@pytest.fixture
def store():
    """ROS 2's messages as rosbags has them, and those of geographic_msgs."""
    typesys = pytest.importorskip("rosbags.typesys", reason="needs rosbags: pip install rosbags")
    found = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        found.register(typesys.get_types_from_msg(text, name))
    return found


def test_rosbags_reads_places_and_times_and_writes_the_same_bytes(store, tmp_path):
    itinerary = make_itinerary()
    raw = write_ros(itinerary, tmp_path / "x.cdr").read_bytes()
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
    assert 2.0 * np.arctan2(turn.z, turn.w) == pytest.approx(np.arctan2(north, east))


def test_cyclonedds_writes_the_same_bytes(store):
    pytest.importorskip("cyclonedds", reason="needs Cyclone DDS: pip install cyclonedds")
    raw = geo_path(make_itinerary())
    message = store.deserialize_cdr(raw, TYPE)
    types = _idl_types()

    def header(stated):
        stamp = types["Time"](sec=stated.stamp.sec, nanosec=stated.stamp.nanosec)
        return types["Header"](stamp=stamp, frame_id=stated.frame_id)

    poses = []
    for stated in message.poses:
        place, turn = stated.pose.position, stated.pose.orientation
        point = types["GeoPoint"](latitude=place.latitude, longitude=place.longitude, altitude=place.altitude)
        attitude = types["Quaternion"](x=turn.x, y=turn.y, z=turn.z, w=turn.w)
        pose = types["GeoPose"](position=point, orientation=attitude)
        poses.append(types["GeoPoseStamped"](header=header(stated.header), pose=pose))
    path = types["GeoPath"](header=header(message.header), poses=poses)
    made = path.serialize()
    assert made[4:].rstrip(b"\0") == raw[4:].rstrip(b"\0")
    assert made[:2] == raw[:2]
    assert (
        types["GeoPath"].deserialize(raw).poses[-1].pose.position.latitude == poses[-1].pose.position.latitude
    )


def _idl_types():
    """The messages as IDL structures of Cyclone DDS."""
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.types import float64, int32, sequence, uint32

    @dataclass
    class Time(IdlStruct):
        sec: int32
        nanosec: uint32

    @dataclass
    class Header(IdlStruct):
        stamp: Time
        frame_id: str

    @dataclass
    class GeoPoint(IdlStruct):
        latitude: float64
        longitude: float64
        altitude: float64

    @dataclass
    class Quaternion(IdlStruct):
        x: float64
        y: float64
        z: float64
        w: float64

    @dataclass
    class GeoPose(IdlStruct):
        position: GeoPoint
        orientation: Quaternion

    @dataclass
    class GeoPoseStamped(IdlStruct):
        header: Header
        pose: GeoPose

    @dataclass
    class GeoPath(IdlStruct):
        header: Header
        poses: sequence[GeoPoseStamped]

    return {
        kind.__name__: kind for kind in (Time, Header, GeoPoint, Quaternion, GeoPose, GeoPoseStamped, GeoPath)
    }
