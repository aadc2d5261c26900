"""What installing auvplan adds to JAX, NumPy, SciPy, scikit-learn and matplotlib, with sizes on disk."""

import argparse
from importlib.metadata import PackageNotFoundError, distribution

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

#: What most people who would use auvplan have already.
KNOWN = ("jax", "numpy", "scipy", "scikit-learn", "matplotlib")
#: Extras of auvplan that are listed as well.
EXTRAS = ("readers", "exact", "dask")


def needed_by(name: str, extra: str = "") -> set[str]:
    """Names of all distributions that one needs, itself among them; of those installed here."""
    found, seen, waiting = set(), set(), [(name, extra)]
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        try:
            requirements = distribution(name).requires or []
        except PackageNotFoundError:
            continue
        found.add(canonicalize_name(name))
        environment = {**default_environment(), "extra": extra}
        for needed in map(Requirement, requirements):
            if needed.marker is None or needed.marker.evaluate(environment):
                waiting += [(canonicalize_name(needed.name), wanted) for wanted in ("", *needed.extras)]
    return found


def size(name: str) -> float:
    files = distribution(name).files or []
    paths = [file.locate() for file in files if not str(file).endswith(".pyc")]
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def table(title: str, names: set[str]) -> None:
    """Print distributions, the largest first."""
    sizes = sorted(((size(name), name) for name in names), reverse=True)
    print(f"{title}: {len(sizes)} distributions, {sum(mb for mb, _ in sizes):.0f} MB")
    for mb, name in sizes:
        print(f"  {name:24} {distribution(name).version:12} {mb:7.1f} MB")


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    known = set().union(*(needed_by(name) for name in KNOWN))
    print(f"{', '.join(KNOWN)} and what they need: {sum(map(size, known)):.0f} MB")
    lean = needed_by("auvplan") - {"auvplan"}
    table("pip install auvplan adds", lean - known)
    for extra in EXTRAS:
        more = needed_by("auvplan", extra) - lean - known - {"auvplan"}
        table(f"pip install 'auvplan[{extra}]' adds to that", more)


if __name__ == "__main__":
    main()
