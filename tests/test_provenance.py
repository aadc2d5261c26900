"""The files that a plan was made of."""

import hashlib

import h5py

from auvplan.scenario.provenance import source_files
from auvplan.view.sheet import MissionSheet, write_html


def test_files_by_name_size_and_hash(tmp_path):
    for name in ("a.nc", "b_1.nc", "b_2.nc"):
        (tmp_path / name).write_bytes(name.encode())
    settings = {
        "current": {"files": ["b_*.nc"], "truth": "a.nc"},
        "bathymetry": {"file": "gone.nc"},
        "chart": {"source": "whitsunday", "file": None},
        "obstacles": None,
    }
    found = source_files(settings, tmp_path)
    assert [(file.field, file.name, file.size) for file in found] == [
        ("current.files", "b_1.nc", 6),
        ("current.files", "b_2.nc", 6),
        ("current.truth", "a.nc", 4),
    ]
    assert found[2].sha256 == hashlib.sha256(b"a.nc").hexdigest()


def test_updates_of_a_cell_are_listed_with_it(tmp_path):
    for name in ("XX5BAY01.000", "XX5BAY01.001", "XX5BAY01.002", "XX5BAY02.001", "XX5BAY01.txt"):
        (tmp_path / name).write_bytes(name.encode())
    found = source_files({"chart": {"source": "enc", "file": "XX5BAY01.000"}}, tmp_path)
    assert [file.name for file in found] == ["XX5BAY01.000", "XX5BAY01.001", "XX5BAY01.002"]
    assert len({file.sha256 for file in found}) == 3


def test_a_folder_has_a_size_and_no_hash(tmp_path):
    (tmp_path / "z.zarr").mkdir()
    (tmp_path / "z.zarr" / "chunk").write_bytes(bytes(10))
    (file,) = source_files({"current": {"files": "z.zarr"}}, tmp_path)
    assert (file.size, file.sha256) == (10, "")


def test_where_a_current_was_fetched_from_is_on_the_sheet(tmp_path):
    origin = {"server": "https://server/dodsC", "dataset": "model.nc", "run": "2026-03-01T00:00:00Z"}
    origin |= {
        "request": "from thredds:https://server/dodsC/model.nc box <1,2,3,4>",
        "request_sha256": "ab" * 32,
    }
    with h5py.File(tmp_path / "f.nc", "w") as file:
        file.attrs.update({f"fetched_{name}": value for name, value in origin.items()})
    files = source_files({"current": {"files": "f.nc"}, "mission": {"jobs": "f.nc"}}, tmp_path)
    assert [file.origin for file in files] == [origin, {}], "only currents are fetched"
    sheet = MissionSheet("bay", {}, (), (), files=files)
    page = write_html(sheet, tmp_path / "sheet.html").read_text()
    assert "f.nc: model.nc from https://server/dodsC, run of 2026-03-01T00:00:00Z" in page
    assert "box &lt;1,2,3,4&gt; (SHA-256 abababababababab)" in page
    assert sheet.plain()["files"][0]["origin"] == origin
