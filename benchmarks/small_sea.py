"""The smallest mission that has all parts, for benchmarks that run very many: a study of it costs little."""

from pathlib import Path

import yaml

import auvplan as ap

SETTINGS = {
    "name": "small sea",
    "site": {"longitude": 5.0, "latitude": 60.0, "departure": "2026-03-01T06:00:00Z"},
    "area": {"lower": [0, 0, 0], "upper": [4000, 4000, 50]},
    "chart": {"source": "none"},
    "current": {"vortices": 3, "layers": 1, "radius": [300, 600], "peak_speed": 0.8, "update_interval": 300},
    "simulation": {"obstacles": {"static": 1, "afloat": 1, "self_motivated": 1}},
    "mission": {"waypoints": 8, "neighbours": 4, "time_available": 5000},
}


def scenario() -> ap.Scenario:
    """Eight waypoints in four kilometres of open water, with vortices and moving obstacles."""
    return ap.Scenario.model_validate(SETTINGS)


def write(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(SETTINGS), encoding="utf-8")
    return path
