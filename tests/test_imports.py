"""No file of the package needs itself to be loaded."""

import grimp


def test_files_import_each_other_in_one_direction():
    graph = grimp.build_graph("auvplan", exclude_type_checking_imports=True)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    # What imports nothing that is left goes, until nothing goes: what stays is in a cycle, or imports one.
    while loaded := [name for name, needed in imports.items() if not needed & imports.keys()]:
        for name in loaded:
            del imports[name]
    assert sorted(imports) == []
