"""The shape of a tree is measured, and what breaks it is named."""

from __future__ import annotations

import sys

import pytest

from tools.shape import (
    find_circles,
    find_long_files,
    find_long_functions,
    find_same_classes,
    find_same_names,
    same_classes,
)


@pytest.fixture
def make_package(tmp_path, monkeypatch):
    """Make an importable package of these modules and the imports in them."""

    def make(name, modules):
        for module, imports in modules.items():
            path = tmp_path / name / f"{module}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            for folder in path.parents[: len(path.relative_to(tmp_path).parts) - 1]:
                (folder / "__init__.py").touch()
            path.write_text("".join(f"import {name}.{other}\n" for other in imports), encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        return name

    yield make
    for module in [module for module in sys.modules if module.startswith("shaped")]:
        del sys.modules[module]


@pytest.mark.parametrize(
    ("of_package", "count"), [([], 0), (["middle"], 0), (["low"], 1)], ids=["nothing", "one way", "both ways"]
)
def test_a_package_and_a_module_in_it_that_import_each_other_are_a_circle(make_package, tmp_path, of_package, count):
    name = make_package("shaped_ring", {"__init__": of_package, "middle": [], "low": []})
    (tmp_path / name / "low.py").write_text(f"import {name}\n", encoding="utf-8")
    assert find_circles(name) == [f"imports make a circle: {name}, {name}.low"] * count


def test_classes_of_the_product_that_share_a_name_are_counted_against_the_budget(tmp_path):
    texts = {"mkdaemon/a": "class Row:\n    class Inner: ...\n", "mkdaemon/b/c": "class Row: ...\nclass _Row: ...\n"}
    texts |= {"mksim/d": "class Row: ...\nclass _Row: ...\n", "other/e": "class Inner: ...\n"}
    for name, text in texts.items():
        path = tmp_path / "src" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    same = same_classes(tmp_path)
    assert same == {"Row": ["src/mkdaemon/a.py", "src/mkdaemon/b/c.py", "src/mksim/d.py"]}
    assert find_same_classes(same, 2) == []
    assert "give the new one its own (Row)" in find_same_classes(same, 1)[0]
    assert "set SAME_CLASSES in tools/shape.py to 2" in find_same_classes(same, 3)[0]


def test_a_file_above_the_limit_is_named():
    lines = {"src/x/a.py": 600, "src/x/b.py": 601, "lab/c.py": 600, "tests/d.py": 900}
    assert find_long_files(lines) == ["src/x/b.py has 601 lines; 600 are allowed"]


def test_a_function_above_the_limit_is_named(tmp_path):
    (tmp_path / "lab").mkdir()
    bodies = {"fits": 59, "long": 60}
    text = "".join(f"async def {name}():\n" + "    pass\n" * count for name, count in bodies.items())
    (tmp_path / "lab" / "a.py").write_text(text, encoding="utf-8")
    assert find_long_functions(tmp_path) == ["lab/a.py:61 long has 61 lines; 60 are allowed"]


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["src/mkdaemon/link/a/x.py", "src/mkdaemon/link/b/x.py"], 1),
        (["src/mkdaemon/link/a/x.py", "src/mkdaemon/link/x.py"], 1),
        (["src/mkdaemon/link/x.py", "src/mkdaemon/control/x.py"], 0),
        (["src/mkdaemon/link/a/__init__.py", "src/mkdaemon/link/b/__init__.py"], 0),
        (["src/mksim/boards/x.py", "src/mksim/physics/x.py"], 1),
        (["src/mkdaemon/cli/mkctl/x.py", "src/mkdaemon/cli/mkdaemon/x.py", "src/mkdaemon/cli/x.py"], 0),
        (["src/mkdaemon/cli/mkctl/x.py", "src/mkdaemon/cli/mkctl/teleop/x.py"], 1),
        (["src/mkdaemon/gateways/ros2/x.py", "src/mkdaemon/gateways/mavlink/x.py"], 0),
        (["lab/a/main.py", "lab/b/main.py"], 0),
    ],
)
def test_modules_of_one_name_in_one_package_are_named(paths, names):
    assert len(find_same_names(paths)) == names
