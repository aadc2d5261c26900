"""Make `auvplan/data/world_land.npz`: Natural Earth's land, which the npm package world-atlas holds.

npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz
python tools/make_world_land.py package/land-10m.json
"""

import json
import sys
from pathlib import Path

import numpy as np

OUT = Path(__file__).parent.parent / "auvplan" / "data" / "world_land.npz"


def main() -> None:
    topology = json.loads(Path(sys.argv[1]).read_text())
    arcs = [np.cumsum(arc, axis=0) for arc in topology["arcs"]]
    (land,) = topology["objects"]["land"]["geometries"]
    transform = topology["transform"]
    scale, origin = (np.array(transform[name]) for name in ("scale", "translate"))
    around, pole = round(360.0 / scale[0]), round((-90.0 - origin[1]) / scale[1])
    rings, parts = [], []
    for polygon in land["arcs"]:
        kept = [ring for ring in (joined(arcs, indices) for indices in polygon) if len(ring) >= 4]
        kept = [unrolled(ring, around, pole) for ring in kept]
        if kept and len(kept[0]) < 6 and (np.abs(kept[0] * scale + origin) < 0.01).all():
            continue  # a mark where the equator meets the first meridian, no land
        rings += kept
        parts += [len(kept)] if kept else []
    places = np.concatenate(rings)
    np.savez_compressed(
        OUT,
        # Steps from place to place are small numbers, which compress well.
        steps=np.diff(places, axis=0, prepend=np.zeros((1, 2), int)).astype(np.int32),
        rings=np.array([len(ring) for ring in rings], np.int32),
        polygons=np.array(parts, np.int32),
        scale=scale,
        origin=origin,
    )
    print(f"{OUT}: {len(parts)} polygons, {len(places)} places, {OUT.stat().st_size} bytes")


def joined(arcs: list[np.ndarray], indices: list[int]) -> np.ndarray:
    """The ring of some arcs, of which negative ones run backwards; the same place twice in a row once."""
    runs = [arcs[index] if index >= 0 else arcs[~index][::-1] for index in indices]
    ring = np.concatenate(runs)
    moved = np.append(True, (np.diff(ring, axis=0) != 0).any(axis=1))
    return ring[moved]


def unrolled(ring: np.ndarray, around: int, pole: int) -> np.ndarray:
    """A ring whose longitudes do not jump at the antimeridian; one around the South Pole goes along it."""
    ring = np.stack([np.unwrap(ring[:, 0], period=around).astype(int), ring[:, 1]], axis=1)
    first, last = ring[0], ring[-1]
    if first[0] != last[0]:
        ring = np.concatenate([ring, [[last[0], pole], [first[0], pole], first]])
    return ring


if __name__ == "__main__":
    main()
