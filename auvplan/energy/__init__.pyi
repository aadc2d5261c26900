from .fit import Fit as Fit
from .fit import fit_power as fit_power
from .power import Battery as Battery
from .power import PowerLaw as PowerLaw
from .power import PowerModel as PowerModel
from .power import PowerTable as PowerTable
from .speeds import best_speed as best_speed
from .speeds import cubic_best_speed as cubic_best_speed
from .speeds import energy_per_metre as energy_per_metre
from .speeds import speed_range as speed_range
from .use import TERMS as TERMS
from .use import EnergyUse as EnergyUse
from .use import energy_along as energy_along
from .use import energy_of_legs as energy_of_legs
from .use import energy_of_plan as energy_of_plan
from .use import energy_of_steps as energy_of_steps

__all__ = [
    "TERMS",
    "Battery",
    "EnergyUse",
    "Fit",
    "PowerLaw",
    "PowerModel",
    "PowerTable",
    "best_speed",
    "cubic_best_speed",
    "energy_along",
    "energy_of_legs",
    "energy_of_plan",
    "energy_of_steps",
    "energy_per_metre",
    "fit_power",
    "speed_range",
]
