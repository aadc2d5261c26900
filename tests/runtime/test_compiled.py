"""Programs that are kept on disk: found again, distinguished, never in the way."""

import ast
import logging
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from PIL import Image

import auvplan as ap
from auvplan.executive.context import Clock
from auvplan.ocean.currents import FunctionCurrent, evaluated, is_steady
from auvplan.runtime import cache
from auvplan.runtime.captured import captured_once
from auvplan.runtime.compiled import (
    Program,
    compilations,
    compiled,
    compiling_ahead,
    drop_programs,
    expecting,
    held,
    listening,
)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache. JAX's own keeps nothing meanwhile: what comes out of that one is not stored."""
    monkeypatch.setenv("AUVPLAN_CACHE", str(tmp_path))
    name = "jax_persistent_cache_min_compile_time_secs"
    before = getattr(jax.config, name)
    jax.config.update(name, 1e9)
    yield tmp_path
    jax.config.update(name, before)


def expected(x, times):
    return np.cumsum(np.sort(x)[::-1]) * times


def program() -> Program:
    """A new one of the same name, as another process would make it."""

    def sorted_sum(x, *, times):
        """A sort is among what some executables cannot be stored with."""
        return jnp.sort(x)[::-1].cumsum() * times

    return compiled(sorted_sum, static_argnames=("times",))


def entries() -> list[cache.Entry]:
    return sorted(cache.entries(), key=lambda entry: entry.path)


def assert_sorted(one: Program) -> None:
    """A program of three numbers computes what it should."""
    np.testing.assert_array_equal(one(np.arange(3.0), times=2), [4.0, 6.0, 6.0])


def test_it_computes_what_jit_does_before_and_after_it_is_loaded(place):
    x = np.array([3.0, 1.0, 2.0])
    np.testing.assert_array_equal(program()(x, times=2), expected(x, 2))
    assert len(entries()) == 1
    used = entries()[0].path.stat().st_mtime_ns
    np.testing.assert_array_equal(program()(x, times=2), expected(x, 2))
    assert [entry.path.stat().st_mtime_ns >= used for entry in entries()] == [True]


def test_those_who_wait_are_told_of_compilations_and_of_nothing_else(place):
    stated = []
    one = program()
    with listening(lambda **counts: stated.append(counts["begun"] - counts["done"])):
        one(np.ones(3), times=2)
        one(np.ones(3), times=2)
        program()(np.ones(3), times=2)
    one(np.ones(4), times=2)
    assert stated == [1, 0]


def test_a_second_call_compiles_and_loads_nothing(place):
    one = program()
    one(np.ones(3), times=2)
    before = compilations()
    one(np.zeros(3), times=2)
    assert compilations() == before


def test_a_process_holds_few_programs_and_computes_on(place, monkeypatch):
    """Linux gives a process 65,530 mappings of memory; one that plans in ever new currents would crash."""
    most = held() + 3
    monkeypatch.setattr("auvplan.runtime.compiled.MOST", most)
    one = program()
    for size in range(2, 12):
        x = np.arange(float(size))
        np.testing.assert_array_equal(one(x, times=2), expected(x, 2))
        assert held() <= most


@pytest.mark.parametrize("change", [{"times": 3}, {"x": np.ones(4)}, {"x": np.ones(3, np.int32)}])
def test_other_settings_shapes_and_types_are_other_programs(place, change):
    given = {"x": np.ones(3), "times": 2}
    one = program()
    for case in (given, given | change):
        x, times = case["x"], case["times"]
        np.testing.assert_array_equal(one(x, times=times), expected(x, times))
    assert len(entries()) == 2


def test_precision_tells_programs_apart(place):
    one = program()
    assert one(np.ones(3), times=2).dtype == np.float32
    with jax.enable_x64(True):
        assert one(np.ones(3), times=2).dtype == np.float64


def test_it_can_be_traced(place):
    one = partial(program(), times=2)
    slopes = jax.jit(jax.grad(lambda x: one(x).sum()))(jnp.arange(3.0))
    np.testing.assert_allclose(slopes, [2.0, 4.0, 6.0])
    assert not entries()


def harmed(change):
    """What changes an entry's bytes."""
    return lambda entry: entry.path.write_bytes(change(entry.path.read_bytes()))


def no_program(entry):
    cache.store(*entry.path.stem.rsplit("-", 1), (b"nothing of the kind", None))


@pytest.mark.parametrize(
    "spoil",
    [harmed(lambda old: old[:-7]), harmed(lambda old: b""), harmed(lambda old: old[:64] + b"x" + old[65:]),
     no_program],
)  # fmt: skip
def test_a_damaged_entry_is_left_out_and_told_to_the_log(place, caplog, spoil):
    assert_sorted(program())
    (entry,) = entries()
    spoil(entry)
    with caplog.at_level(logging.INFO, "auvplan.runtime.cache"):
        assert_sorted(program())
        assert len(caplog.messages) == 1
        assert "made again" in caplog.text
        caplog.clear()
        assert_sorted(program())
    assert not caplog.messages


def test_nothing_is_kept_where_that_is_switched_off_or_cannot_be(place, monkeypatch, caplog):
    monkeypatch.setenv("AUVPLAN_CACHE", "off")
    assert_sorted(program())
    monkeypatch.setenv("AUVPLAN_CACHE", str(place))
    assert not entries()
    (place / "file").write_text("in the way")
    monkeypatch.setenv("AUVPLAN_CACHE", str(place / "file"))
    with caplog.at_level(logging.INFO, "auvplan.runtime.cache"):
        assert_sorted(program())
    assert "is not stored" in caplog.text


def test_the_entries_not_used_for_longest_go_first(place):
    one = program()
    for length in (3, 4, 5):
        one(np.ones(length), times=2)
    size = {entry.path: entry.size for entry in entries()}
    oldest, *newer = sorted(size, key=lambda path: path.stat().st_mtime_ns)
    removed = cache.trim(limit=sum(size[path] for path in newer))
    assert [entry.path for entry in removed] == [oldest]
    assert {entry.path for entry in entries()} == set(newer)


@partial(jax.tree_util.register_dataclass, data_fields=("speed",), meta_fields=())
@dataclass(frozen=True)
class Stream:
    """A current of somebody else's, whose code may change from one process to the next."""

    speed: jax.Array

    def __call__(self, x, y, z, t):
        return self.speed + 0.0 * x, 0.0 * x, 0.0 * x


def test_what_other_classes_do_is_not_kept(place):
    drop_programs()  # others may have looked up as many places
    evaluated(Stream(np.float32(1.0)), *np.ones((4, 3)))
    assert not entries()
    evaluated(ap.UniformCurrent(1.0), *np.ones((4, 3)))
    assert len(entries()) == 1


def a_stream(strength):
    return FunctionCurrent(lambda x, y, z, t: (strength, 0.1 * x, jnp.sin(t)))


def test_functions_are_told_apart_by_what_they_do():
    one, same, other = a_stream(0.4), a_stream(0.4), a_stream(0.5)
    assert one.fingerprint() == same.fingerprint() is not None
    assert other.fingerprint() != one.fingerprint()
    table = np.arange(100.0)
    tables = [
        FunctionCurrent(
            lambda x, y, z, t, table=table: (jax.jit(lambda x: x * table.sum() + table[0])(x), 0.0, 0.0)
        )
        for table in (table, table + 1.0)
    ]
    assert tables[0].fingerprint() != tables[1].fingerprint()


def test_functions_that_hide_arrays_are_told_apart():
    def looked_up(table):
        inner = jax.jit(lambda x: jnp.interp(x, jnp.arange(100.0), table))
        return FunctionCurrent(lambda x, y, z, t: (inner(x), 0.0, 0.0))

    table = np.linspace(0.0, 1.0, 100)
    marks = [looked_up(jnp.asarray(values)).fingerprint() for values in (table, table, np.flip(table))]
    assert marks[0] is None or (marks[0] == marks[1] != marks[2])


#: What functions read from their module.
STRENGTH = 1.0


def test_functions_are_other_ones_once_what_they_read_has_changed(monkeypatch):
    settings = ModuleType("settings")
    settings.strength = 1.0
    listed, held, named = [1.0], SimpleNamespace(strength=1.0), {"strength": 1.0}
    enclosed, large, chain = 1.0, np.ones(400_001), [[[[[[1.0]]]]]]
    series = xr.DataArray([1.0, 2.0], dims="x")

    class Jet:
        strength = 1.0

        def __call__(self, x, y, z, t):
            return self.strength, 0.0, 0.0

    class Slotted:
        __slots__ = ("strength",)

    slotted = Slotted()
    slotted.strength = 1.0

    def helper(x):
        return x * STRENGTH

    def change():
        nonlocal enclosed
        enclosed = 2.0

    changes = {
        lambda x, y, z, t: (STRENGTH, 0.0, 0.0): partial(monkeypatch.setitem, globals(), "STRENGTH", 2.0),
        lambda x, y, z, t: (helper(1.0), 0.0, 0.0): partial(monkeypatch.setitem, globals(), "STRENGTH", 3.0),
        lambda x, y, z, t: (listed[0], 0.0, 0.0): partial(listed.__setitem__, 0, 2.0),
        lambda x, y, z, t: (held.strength, 0.0, 0.0): partial(setattr, held, "strength", 2.0),
        lambda x, y, z, t: (named["strength"], 0.0, 0.0): partial(named.__setitem__, "strength", 2.0),
        lambda x, y, z, t: (enclosed, 0.0, 0.0): change,
        lambda x, y, z, t: (settings.strength, 0.0, 0.0): partial(setattr, settings, "strength", 2.0),
        lambda x, y, z, t: (large[200_001], 0.0, 0.0): partial(large.__setitem__, 200_001, 2.0),
        lambda x, y, z, t: (chain[0][0][0][0][0][0], 0.0, 0.0): partial(
            chain[0][0][0][0][0].__setitem__, 0, 2.0
        ),
        lambda x, y, z, t: (large.sum() + jnp.asarray(large)[200_001], 0.0, 0.0): partial(
            large.__setitem__, 200_001, 3.0
        ),
        lambda x, y, z, t: (series.values[1], 0.0, 0.0): partial(series.__setitem__, 1, 3.0),
        lambda x, y, z, t: (slotted.strength, 0.0, 0.0): partial(setattr, slotted, "strength", 2.0),
        Jet(): partial(setattr, Jet, "strength", 2.0),
    }
    for function, change_it in changes.items():
        current = FunctionCurrent(function)
        strength = float(function(0.0, 0.0, 0.0, 0.0)[0])
        mark, tree = current.fingerprint(), jax.tree.structure(current)
        for _ in range(2):  # as long as nothing changes, it is the same
            np.testing.assert_array_equal(evaluated(current, *np.ones((4, 3)))[0], strength)
        assert (current.fingerprint(), jax.tree.structure(current)) == (mark, tree)
        change_it()
        assert float(function(0.0, 0.0, 0.0, 0.0)[0]) != strength
        assert (mark is None) == isinstance(function, Jet)  # an object has no byte code of its own
        assert current.fingerprint() != mark or mark is None
        assert jax.tree.structure(current) != tree
        np.testing.assert_array_equal(
            evaluated(current, *np.ones((4, 3)))[0], float(function(0.0, 0.0, 0.0, 0.0)[0])
        )


def test_an_environment_holds_functions_as_they_are_now():
    """What is known of a function, such as that it is steady, is not kept from the time when it was given."""
    turning = [0.0]
    env = ap.Environment(lambda x, y, z, t: (0.1 * y, turning[0] * t if turning[0] else 0.0, 0.0))
    assert is_steady(env.current)
    turning[0] = 1.0
    assert not is_steady(env.current)


def test_within_one_call_functions_are_traced_once():
    traces = []

    def stream(x, y, z, t):
        traces.append(np.shape(x))
        return 0.1, 0.0, 0.0

    current = FunctionCurrent(stream)
    with captured_once():
        tree = jax.tree.structure(current)
        with captured_once():
            assert jax.tree.structure(current) == tree
    assert traces == [(), (3,)]
    assert jax.tree.structure(current) == tree
    assert len(traces) == 4


def test_a_function_may_read_what_is_traced_and_keys():
    key = jax.random.key(0)

    def stream(strength):
        noise = jax.random.uniform(key)
        return FunctionCurrent(lambda x, y, z, t: (strength + 0.0 * noise, jax.random.uniform(key), 0.0))

    def speed(strength):
        (_, tree), at = jax.tree.flatten(stream(strength)), jnp.zeros(())
        return tree.unflatten([])(at, at, at, at)[0]

    assert float(jax.grad(speed)(1.0)) == 1.0


def test_a_function_that_cannot_be_traced_has_no_fingerprint():
    assert FunctionCurrent(lambda x, y, z, t: (float(x), 0.0, 0.0)).fingerprint() is None


MOVED = """
import numpy as np
from auvplan.ocean.currents import FunctionCurrent, evaluated
stream = FunctionCurrent(lambda x, y, z, t: (0.1 * x, {speed}, 0.0))
print(np.asarray(evaluated(stream, *np.ones((4, 3)))).tolist())
"""


def test_another_process_finds_programs_of_a_function_and_none_of_another(place, capsys):
    code = MOVED.format(speed=0.5)
    first = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    kept = {entry.path for entry in entries()}
    assert kept
    drop_programs()
    exec(code, {})
    assert capsys.readouterr().out == first
    assert {entry.path for entry in entries()} == kept
    exec(MOVED.format(speed=0.9), {})
    assert capsys.readouterr().out != first
    assert {entry.path for entry in entries()} > kept


def test_ahead_of_their_use_large_programs_are_compiled_and_not_run(place):
    def doubled(x):
        return {"twice": 2.0 * x, "key": jax.random.split(jax.random.key(1), 2)}

    large = compiled(doubled, wide=True)
    with compiling_ahead():
        for _ in range(2):
            outline = large(np.ones(3))
            np.testing.assert_array_equal(outline["twice"], np.zeros(3))
            assert outline["key"].shape == (2,)
        assert_sorted(program())
    np.testing.assert_array_equal(large(np.ones(3))["twice"], [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(compiled(doubled, wide=True)(np.ones(3))["twice"], [2.0, 2.0, 2.0])


def test_what_an_occasion_used_is_kept_by_what_it_is_of_too(place):
    one = program()
    for of, times in (("this", 21), ("that", 22)):
        with expecting("tests", of):
            one(np.arange(3.0), times=times)
    this, that, last = (
        cache.load("auvplan.runtime.compiled.expecting", cache.key_of(name))
        for name in ("tests this", "tests that", "tests")
    )
    assert len(this) == len(that) == 1
    assert last == this + that
    keys = {entry.path.stem.rsplit("-", 1)[1] for entry in entries() if "sorted_sum" in entry.name}
    assert {key for _, key in last} == keys


def test_the_command_shows_and_clears_what_is_kept(place, call, monkeypatch):
    assert_sorted(program())
    for arguments, said in (((), "of at most 1000 MB"), (("--clear",), "1 entry removed")):
        _, out, _ = call("cache", *arguments)
        assert said in out
    assert not entries()
    monkeypatch.setenv("AUVPLAN_CACHE", "off")
    _, out, _ = call("cache")
    assert "AUVPLAN_CACHE is off" in out


def test_the_command_says_what_was_left_out(place, caplog, call, tmp_path):
    picture = tmp_path / "chart.png"
    Image.fromarray(np.full((8, 8, 3), (70, 130, 200), np.uint8)).save(picture)
    for _ in range(2):
        call("--verbose", "chart", picture, "--out", tmp_path / "out")
        (entry,) = (entry for entry in entries() if "classify" in entry.name)
        entry.path.write_bytes(b"damaged")
    assert "made again" in caplog.text


def test_compiled_code_is_in_packages_that_keys_depend_on():
    """No module that holds a program imports from those whose changes programs outlive."""
    home = Path(ap.__file__).parent
    for path in home.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        tree = ast.walk(ast.parse(text)) if "compiled" in text else ()
        imports = [node for node in tree if isinstance(node, ast.ImportFrom)]
        if "compiled" in {alias.name for node in imports for alias in node.names}:
            rooms = {(node.module or "").split(".")[1:2][0] for node in imports if "." in (node.module or "")}
            assert not rooms & set(cache.UNCOMPILED), path


@pytest.mark.parametrize(("changed", "same"), [("cli/tools.py", True), ("path/cost.py", False)])
def test_keys_depend_on_the_code_that_is_compiled(tmp_path, changed, same):
    home = tmp_path / "auvplan"
    shutil.copytree(Path(ap.__file__).parent, home, ignore=shutil.ignore_patterns("data", "__pycache__"))
    before = cache.digest_of_sources(home)
    (home / changed).write_text("")
    assert (cache.digest_of_sources(home) == before) == same


def test_keys_depend_on_the_whole_package():
    assert Path(ap.__file__).parent == cache.HOME


def test_short_calls_that_compile_are_made_again_to_be_timed_and_long_ones_are_not():
    made, clock = [], Clock()

    def call(lasts):
        made.append(lasts)
        time.sleep(lasts)
        return double(jnp.arange(float(len(made))))

    double = compiled(lambda x: 2.0 * x)
    assert clock.time(lambda: call(0.01))[1] < 2.0
    short = clock.compile_seconds
    assert made == [0.01, 0.01]
    assert short > 0.01
    _, seconds = clock.time(lambda: call(2.1))
    assert made == [0.01, 0.01, 2.1]
    assert seconds > 2.0
    assert clock.compile_seconds > short
