"""The files that a plan was made of."""

import hashlib

from auvplan.scenario.provenance import source_files


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


def test_a_folder_has_a_size_and_no_hash(tmp_path):
    (tmp_path / "z.zarr").mkdir()
    (tmp_path / "z.zarr" / "chunk").write_bytes(bytes(10))
    (file,) = source_files({"current": {"files": "z.zarr"}}, tmp_path)
    assert (file.size, file.sha256) == (10, "")
