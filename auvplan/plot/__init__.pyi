from .animation import animate_run as animate_run
from .chart import draw_chart as draw_chart
from .chart import plot_chart as plot_chart
from .convergence import plot_convergence as plot_convergence
from .departures import plot_departures as plot_departures
from .energy import plot_energy as plot_energy
from .energy import plot_power as plot_power
from .mission import plot_mission as plot_mission
from .paths import plot_currents as plot_currents
from .paths import plot_path as plot_path
from .run import busiest_leg as busiest_leg
from .run import draw_run as draw_run
from .space import plot_obstacles as plot_obstacles
from .study import draw_study as draw_study
from .timeline import plot_timeline as plot_timeline

__all__ = [
    "animate_run",
    "busiest_leg",
    "draw_chart",
    "draw_run",
    "draw_study",
    "plot_chart",
    "plot_convergence",
    "plot_currents",
    "plot_departures",
    "plot_energy",
    "plot_mission",
    "plot_obstacles",
    "plot_path",
    "plot_power",
    "plot_timeline",
]
