"""A scenario: everything that a mission needs to know but its seed, validated."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Finite, Finite, Finite]


class Section(BaseModel):
    """Base of all sections: unknown keys are faults, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Area(Section):
    """Box of the mission in local metres: north, east, depth (positive down)."""

    lower: Point = (0.0, 0.0, 0.0)
    upper: Point = (10_000.0, 10_000.0, 1000.0)

    @model_validator(mode="after")
    def _ordered(self) -> "Area":
        low, high = self.lower, self.upper
        if low[0] >= high[0] or low[1] >= high[1] or low[2] > high[2]:
            raise ValueError("lower must be below upper (depths may be equal)")
        return self


class ChartSettings(Section):
    """Where the coast comes from."""

    source: Literal["whitsunday", "image", "none"] = "whitsunday"
    image: str | None = Field(default=None, description="path of a picture, relative to the scenario file")
    pixel_size: Positive = Field(default=10.0, description="m")
    clearance: NotNegative = Field(default=150.0, description="m, least distance of waypoints to the coast")
    window: tuple[int, int, int, int] | None = Field(
        default=None, description="first row (north), first column (east), rows, columns to cut out, pixels"
    )

    @model_validator(mode="after")
    def _image_given(self) -> "ChartSettings":
        if (self.source == "image") != (self.image is not None):
            raise ValueError("image must be given with source 'image', and only then")
        return self


class VehicleSettings(Section):
    """Speed and limits, m/s and rad/s."""

    speed: Positive = 2.5
    surge_max: Positive = 5.0
    sway_max: Positive = 1.5
    turn_rate_max: Positive = 0.1


class CurrentSettings(Section):
    """The true current: layered Lamb vortices that change at every update (Eqs 1-2)."""

    vortices: Annotated[int, Field(ge=0, le=64)] = 12
    layers: Annotated[int, Field(ge=1, le=10)] = 3
    radius: tuple[Positive, Positive] = Field(default=(500.0, 1500.0), description="m")
    peak_speed: NotNegative = Field(default=1.25, description="m/s")
    vertical_scale: NotNegative = Field(default=5.0, description="gamma of Eq. 1, m")
    uniform: Point = Field(default=(0.0, 0.0, 0.0), description="m/s north, east, down, added everywhere")
    update_interval: Positive = Field(default=600.0, description="s")
    update_rate: NotNegative = Field(default=1.0, description="U_R^C of Eq. 2")
    center_std: NotNegative = Field(default=50.0, description="m per update")
    radius_std: NotNegative = Field(default=20.0, description="m per update")
    strength_std: NotNegative = Field(default=0.05, description="share per update")
    forecast_error: NotNegative = Field(
        default=0.02, description="relative error of what the planner is told"
    )


class ObstacleSettings(Section):
    """True obstacles, drawn anew between the two waypoints of each leg."""

    static: Annotated[int, Field(ge=0, le=50)] = 2
    afloat: Annotated[int, Field(ge=0, le=50)] = 2
    self_motivated: Annotated[int, Field(ge=0, le=50)] = 2
    radius: tuple[Positive, Positive] = Field(default=(20.0, 60.0), description="m")
    speed: NotNegative = Field(default=0.3, description="m/s, own speed of self-motivated ones")

    @property
    def total(self) -> int:
        return self.static + self.afloat + self.self_motivated


class SensorSettings(Section):
    """What the vehicle knows of obstacles, before and within sensor range."""

    range: NotNegative = Field(default=600.0, description="m")
    interval: Positive = Field(default=30.0, description="s between looks")
    prior_std: NotNegative = Field(default=10.0, description="m, position and radius, known beforehand")
    position_std: NotNegative = Field(default=2.0, description="m, within range")
    velocity_std: NotNegative = Field(default=0.03, description="m/s")
    growth: NotNegative = Field(default=0.1, description="m/s, growth of the boundary since the last look")
    growth_max: NotNegative = Field(
        default=24.0, description="m; what grows while a vehicle sails as far as its sensors reach"
    )


class MissionSettings(Section):
    """The task graph: random waypoints in the water, each linked to its nearest."""

    waypoints: Annotated[int, Field(ge=2, le=1000)] = 40
    neighbours: Annotated[int, Field(ge=1, le=100)] = 7
    priority: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]] = (1, 5)
    duration: tuple[NotNegative, NotNegative] = Field(default=(30.0, 300.0), description="s")
    time_available: Positive = Field(default=14_400.0, description="s")
    start: Point | None = Field(default=None, description="m north, east, depth; drawn if absent")
    goal: Point | None = Field(default=None, description="m north, east, depth; drawn if absent")


class PlanningSettings(Section):
    """How the mission is planned and re-planned."""

    preset: Literal["default", "paper"] = "default"
    effort: Literal["quick", "full", "plain"] = Field(
        default="quick",
        description="of the preset 'default': 'quick' plans paths and later orders in a fifth of the time of "
        "'full'; 'plain' is the search alone, without passages, beams, local search and gradients",
    )
    objective: Literal["priority", "eq15"] | None = Field(default=None, description="of the preset if absent")
    travel_times: Literal["sea", "distance"] | None = Field(
        default=None,
        description="of the edges: 'sea' in the current as it is told, 'distance' d / |v| as in Eq. 13; "
        "if absent 'sea', with the preset 'paper' 'distance'",
    )
    detour: NotNegative = Field(
        default=3.5, description="s that each obstacle is taken to cost a leg; with travel_times 'sea'"
    )
    t_series: Annotated[int, Field(ge=1, le=20)] = 4
    replan_from: Literal["kept", "fresh"] = Field(
        default="kept", description="population that a path is planned anew from on the way"
    )
    window_change: NotNegative | None = Field(
        default=None,
        description="share by which the time left on a path must have changed for a window to plan it anew; "
        "0 does at every window, as the preset 'paper' does; if absent 0.01",
    )
    reserve: NotNegative = Field(
        default=60.0, description="s of the available time that no order is planned to use"
    )
    return_margin: NotNegative | None = Field(
        default=None,
        description="share by which the way back is taken to last longer than expected; if absent 0.2 with "
        "travel times of the sea, 0.4 by distance",
    )
    replan: Literal["late", "deviation"] = Field(
        default="deviation",
        description="'late' as in the paper, after every leg that took longer than expected; 'deviation' "
        "when the rest of the order no longer fits the time that is left, or would leave much of it",
    )
    tolerance: NotNegative = Field(
        default=30.0, description="s by which the rest of an order may overrun the reserve ('deviation')"
    )
    gain: Positive = Field(
        default=120.0, description="s left over that make a new order worth planning ('deviation')"
    )
    charge_compute: bool = Field(
        default=False, description="charge planning time to the mission clock (Eq. 16)"
    )

    @property
    def least_window_change(self) -> float:
        """`window_change`, or what stands for it."""
        if self.window_change is not None:
            return self.window_change
        return 0.0 if self.preset == "paper" else 0.01


class Scenario(Section):
    """A whole scenario; see each section."""

    name: str = "unnamed"
    description: str = ""
    area: Area = Area()
    chart: ChartSettings = ChartSettings()
    vehicle: VehicleSettings = VehicleSettings()
    current: CurrentSettings = CurrentSettings()
    obstacles: ObstacleSettings = ObstacleSettings()
    sensors: SensorSettings = SensorSettings()
    mission: MissionSettings = MissionSettings()
    planning: PlanningSettings = PlanningSettings()

    @model_validator(mode="after")
    def _consistent(self) -> "Scenario":
        for name in ("start", "goal"):
            point = getattr(self.mission, name)
            if point is None:
                continue
            inside = all(a <= p <= b for a, p, b in zip(self.area.lower, point, self.area.upper, strict=True))
            if not inside:
                raise ValueError(f"mission.{name} {point} lies outside the area")
        return self
