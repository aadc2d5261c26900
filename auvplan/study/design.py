"""What a study runs: which settings, swept over which values, for which seeds."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import yaml

from auvplan.errors import ScenarioError, StudyError
from auvplan.runtime import MAX_SEED
from auvplan.runtime.arguments import instance
from auvplan.scenario.file import validate_scenario
from auvplan.scenario.scenario import Scenario, change_scenario


@dataclass(frozen=True)
class Sweep:
    """A setting and the values that it takes.

    Attributes:
        field: "section.name" of the scenario.
        values: at least one.
    """

    field: str
    values: tuple[Any, ...]

    @property
    def dim(self) -> str:
        """Name of its dimension in a dataset."""
        return self.field.replace(".", "_")

    @classmethod
    def parse(cls, text: str) -> "Sweep":
        """From "section.name=1,2,3"; values are YAML, a list of lists is written in brackets.

        Raises:
            StudyError: the text has no values, or not the form.
        """
        field, mark, given = text.partition("=")
        field = field.strip()
        try:
            values = yaml.safe_load(given if given.strip().startswith("[") else f"[{given}]")
        except (yaml.YAMLError, RecursionError):
            values = None
        names = [name.strip() for name in field.split(".")]
        if not mark or len(names) < 2 or not all(names) or not isinstance(values, list) or not values:
            shown = text if len(text) <= 200 else f"{text[:197]}..."
            raise StudyError(f"sweep {shown!r}: give it as section.name=value,value,...")
        # YAML takes 1e4, without a point, for text.
        bare = re.compile(r"[-+]?\d+[eE][-+]?\d+")
        values = [float(v) if isinstance(v, str) and bare.fullmatch(v) else v for v in values]
        if any(value in values[:place] for place, value in enumerate(values)):
            raise StudyError(f"sweep {text!r}: a value is given twice")
        return cls(field, tuple(values))


@dataclass(frozen=True)
class Design:
    """All missions of a study: every combination of swept values, the same seeds in each.

    Attributes:
        scenario: settings that are not swept.
        count: missions of each case, of seeds `seed`, `seed` + 1, ...
        seed: the first one.
        sweeps: settings that vary, the last one fastest.

    Raises:
        StudyError: count or seed are out of range or not whole, or a sweep has no values.
        TypeError: the scenario is none.
    """

    scenario: Scenario
    count: int
    seed: int = 0
    sweeps: tuple[Sweep, ...] = ()

    def __post_init__(self) -> None:
        instance("scenario", self.scenario, Scenario, "ap.load_scenario(...)")
        if not isinstance(self.count, int) or not isinstance(self.seed, int):
            raise StudyError(f"count and seed must be whole numbers, got {self.count!r} and {self.seed!r}")
        for sweep in self.sweeps:
            if isinstance(sweep.values, str) or not sweep.values:
                raise StudyError(f"sweep of {sweep.field}: give at least one value, got {sweep.values!r}")
        if self.count < 1:
            raise StudyError(f"a study needs at least one mission, got {self.count}")
        if self.seeds[0] < 0 or self.seeds[-1] > MAX_SEED:
            at = f"seeds {self.seeds[0]} to {self.seeds[-1]}"
            raise StudyError(f"{at} of the study's missions: a seed is from 0 to {MAX_SEED}")

    @property
    def seeds(self) -> range:
        """Seeds of every case."""
        return range(self.seed, self.seed + self.count)

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of values of the sweeps."""
        return tuple(len(sweep.values) for sweep in self.sweeps)

    @cached_property
    def cases(self) -> list[Scenario]:
        """The scenario of every combination.

        Raises:
            ScenarioError: a value does not fit; one line that names the field and the reason.
        """
        fields = [sweep.field for sweep in self.sweeps]
        for field in fields:
            if fields.count(field) > 1:
                raise ScenarioError(f"sweep: {field}: swept twice")
        cases = []
        for values in product(*(sweep.values for sweep in self.sweeps)):
            cases.append(change_scenario(self.scenario, dict(zip(fields, values, strict=True)), "sweep"))
        return cases

    @property
    def tasks(self) -> list[tuple[int, int]]:
        """Case and seed of every mission."""
        return [(case, seed) for case in range(len(self.cases)) for seed in self.seeds]

    def plain(self) -> dict[str, Any]:
        """Everything that decides the results, ready for JSON."""
        return {
            "scenario": self.scenario.model_dump(mode="json"),
            "count": self.count,
            "seed": self.seed,
            "sweeps": {sweep.field: list(sweep.values) for sweep in self.sweeps},
        }

    @classmethod
    def of(cls, plain: dict[str, Any]) -> "Design":
        """Back from `plain`."""
        sweeps = tuple(Sweep(field, tuple(values)) for field, values in plain["sweeps"].items())
        scenario = validate_scenario(plain["scenario"], "study")
        return cls(scenario, int(plain["count"]), int(plain["seed"]), sweeps)


def by_case(tasks: Sequence[tuple[int, int]]) -> dict[int, list[int]]:
    """Seeds of each case."""
    found: dict[int, list[int]] = {}
    for case, seed in tasks:
        found.setdefault(case, []).append(seed)
    return found
