"""Cases in processes of their own: what becomes of those that die."""

import os

import pytest

from benchmarks.apart import Late, run_apart, within


def work(folder, pipe):
    for number in iter(pipe.recv, None):
        pipe.send("changed")
        begun = folder / f"{number}"
        if number == 3 or (number == 1 and not begun.exists()):
            begun.touch()
            os._exit(7)
        pipe.send(("right",))


def test_a_case_that_kills_its_process_is_begun_once_more(tmp_path):
    found = [(number, became) for number, _, became in run_apart(work, (tmp_path,), range(5), "fork")]
    assert found == [(0, "right"), (1, "right"), (2, "right"), (3, "the process died (7)"), (4, "right")]


def test_no_more_cases_are_begun_when_it_is_enough(tmp_path):
    seen = []
    for number, *_ in run_apart(work, (tmp_path,), range(5), "fork", more=lambda: len(seen) < 2):
        seen.append(number)
    assert seen == [0, 1]


def test_what_takes_too_long_is_broken_off():
    def endless():
        while True:
            pass

    with within(0.05), pytest.raises(Late, match=r"longer than 0\.05 s"):
        endless()
