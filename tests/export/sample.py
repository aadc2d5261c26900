"""A small hand-made itinerary: two legs across the antimeridian, south of the equator."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from auvplan.export import Circle, Itinerary, PlannedLeg, Polygon, Track
from auvplan.path.motion import Motion
from auvplan.site import Site

EPOCH = datetime(2024, 2, 28, 23, 59, 30, 500_000, tzinfo=UTC)
SITE = Site(179.995, -41.3, EPOCH, origin=(700.0, -300.0))
NAMES = ("harbour", "wreck & reef", "mooring <7>")


def make_leg(
    number: int, start: int, goal: int, places, times, kept, hold: float, priority: float, motion=None
) -> PlannedLeg:
    """A leg with some samples kept; straight lines take 1 % less."""
    leg = PlannedLeg.of(
        number, start, goal, places, times, names=NAMES, hold=hold, priority=priority, motion=motion
    )
    kept = np.asarray(kept)
    return replace(leg, kept=kept, kept_times=times[0] + 0.99 * (times[kept] - times[0]), time_change=-0.01)


def make_itinerary(site: Site = SITE, *, over_ground: bool = False) -> Itinerary:
    """From the west of the antimeridian to the east and back, at different depths."""
    share = np.linspace(0.0, 1.0, 9)[:, None]
    first = np.array([820.0, -450.0, 12.5]) + share * np.array([900.0, 1400.0, 30.0])
    first[:, 0] += 130.0 * np.sin(np.pi * share[:, 0])
    second = first[-1] + share * np.array([-2100.0, -700.0, -35.25])
    second[:, 1] += 90.0 * np.sin(np.pi * share[:, 0])
    times = 60.0 + 100.0 * np.arange(9.0)
    stream = np.broadcast_to([0.1, -0.3, 0.0], (8, 3))
    motion = Motion.along("track", 1.75, np.diff(first, axis=0), stream)
    legs = (
        make_leg(1, 0, 1, first, times, [0, 3, 5, 8], 45.5, 3.0, motion),
        make_leg(2, 1, 2, second, times + 845.5, [0, 8], 0.0, 0.0),
    )
    executed = (
        Track(times[:5] + 0.25, first[:5] + np.array([3.0, -2.0, 0.5])),
        Track(times + 846.0, second - np.array([1.0, 4.0, 0.25])),
    )
    fences = (
        Polygon(np.array([[-900.0, -200.0], [-600.0, 900.0], [-1300.0, 700.0]])),
        Polygon(np.array([[2400.0, -900.0], [2500.0, -600.0], [2300.0, -700.0], [2350.0, -850.0]])),
        Circle((2000.0, 1800.0), 85.0),
    )
    return Itinerary(
        "reef, day 2",
        site,
        1.75,
        legs,
        executed,
        fences,
        42,
        '{"name": "reef"}',
        "9.8.7",
        ("a note",),
        over_ground=over_ground,
    )


#: m/s through the water, and corners, m, of a path that turns with and against a current.
SPEED = 1.2
CORNERS = np.array([[0, 0, 5], [300, 0, 5], [600, 10, 8], [620, 400, 8], [200, 420, 10], [0, 500, 10]], float)


def in_current(stream) -> Itinerary:
    """A leg along corners at `SPEED` through the water, and a second one on from there."""
    stream = np.asarray(stream, float)
    way = np.diff(CORNERS, axis=0)
    motion = Motion.along("track", SPEED, way, np.broadcast_to(stream, way.shape))
    made = np.linalg.norm(motion.ground_velocity, axis=1)
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(way, axis=1) / made)])
    first = PlannedLeg.of(1, 0, 1, CORNERS, passed, hold=40.0, priority=1.0, motion=motion)
    on = np.stack([CORNERS[-1], CORNERS[-1] + [-300.0, -200.0, 0.0]])
    along = Motion.along("track", SPEED, np.diff(on, axis=0), stream[None])
    leaves = passed[-1] + 40.0
    arrives = leaves + np.linalg.norm(on[1] - on[0]) / np.linalg.norm(along.ground_velocity[0])
    second = PlannedLeg.of(2, 1, 2, on, [leaves, arrives], motion=along)
    return Itinerary("in a current", SITE, SPEED, (first, second))


#: m/s through the water of three legs; the second has the vehicle's, which is `SPEED`.
SPEEDS = (0.9, None, 1.5)
_WAYS = ([[400, 0, 3], [200, 100, 0]], [[-100, 500, 0]], [[300, 300, 2], [0, 300, -2]])


def at_speeds(stream, speeds=SPEEDS) -> Itinerary:
    """Three legs of one or two lines in a current, at speeds of their own; a task is after the first."""
    place, now, legs = np.array([0.0, 0.0, 5.0]), 0.0, []
    for number, (way, own) in enumerate(zip(map(np.array, _WAYS), speeds, strict=True), 1):
        motion = Motion.along("track", own or SPEED, way, np.broadcast_to(stream, way.shape))
        lasts = np.linalg.norm(way, axis=1) / np.linalg.norm(motion.ground_velocity, axis=1)
        places = place + np.concatenate([np.zeros((1, 3)), np.cumsum(way, axis=0)])
        times = now + np.concatenate([[0.0], np.cumsum(lasts)])
        hold = 40.0 if number == 1 else 0.0
        leg = PlannedLeg.of(number, number - 1, number, places, times, hold=hold, motion=motion)
        legs.append(replace(leg, speed=own))
        place, now = places[-1], times[-1] + hold
    return Itinerary("at speeds", SITE, SPEED, tuple(legs))
