"""A small mission in open water and a light search, for tests of the hierarchical loop."""

from auvplan.executive import mission_configs, path_config
from auvplan.mission import MissionConfig
from auvplan.path import PathConfig
from auvplan.scenario.scenario import Scenario

SMALL = {
    "name": "small",
    "area": {"lower": [0, 0, 0], "upper": [4000, 4000, 50]},
    "chart": {"source": "none"},
    "current": {"vortices": 3, "layers": 1, "radius": [300, 600], "peak_speed": 0.8, "update_interval": 300},
    "simulation": {"obstacles": {"static": 1, "afloat": 1, "self_motivated": 1}},
    "mission": {"waypoints": 8, "neighbours": 4, "time_available": 5000},
    "planning": {"t_series": 3, "effort": "plain"},
}

#: A power model with as much energy as the small mission may ask for.
POWER = {"hotel": 40, "propulsion": {"constant": 8, "factor": 12}, "battery": {"capacity": 2000}}


def scenario(**sections) -> Scenario:
    """The small mission with whole sections replaced."""
    return Scenario.model_validate(SMALL | sections)


def planning(**settings) -> Scenario:
    """The small mission with some planning settings changed."""
    return scenario(planning=SMALL["planning"] | settings)


def light_config(settings: Scenario, ahead: bool = False) -> PathConfig:
    """Settings of a small path search: what is tested with it does not depend on the search's depth.

    It begins without passages, which are costly to compile, unless a scenario asks for "quick".
    """
    effort = "quick" if settings.planning.effort == "quick" else "plain"
    plain = settings.planning.model_copy(update={"effort": effort})
    config = path_config(settings.model_copy(update={"planning": plain}))
    bbo = config.bbo.replace(population=24, iterations=9)
    cells = {"field_cells": 28, "dense_cells": 56}
    return config.replace(bbo=bbo, samples=64, refine_steps=0, passage_steps=0, control_points=6, **cells)


def light_routes(settings: Scenario) -> tuple[MissionConfig, MissionConfig]:
    """Settings of a small search for routes, likewise."""
    first, later = (
        config.replace(
            bbo=config.bbo.replace(population=24, iterations=24),
            seeds=min(config.seeds, 10),
            beam_width=config.beam_width and min(config.beam_width, 64),
        )
        for config in mission_configs(settings)
    )
    return first, later


#: What stands in for the settings of the loop's searches, by its name there.
LIGHT = {"path_config": light_config, "mission_configs": light_routes}
