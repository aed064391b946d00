import functools
import importlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hydra.utils import instantiate

import sgbd.recipe
from sgbd.adjacency import border_pairs, bounding_box_pairs
from sgbd.graph import GraphBuilder
from sgbd.recipe import RecipeError, code_digest, describe, folder_name, graph_recipe, recipe_hash
from sgbd.superpixels import Slic
from tests.boxes import Boxes, Grid, write_boxes


@dataclass
class Camera:
    focal: float = 2.0


class Component:
    def __init__(self, camera: Camera, sizes: tuple[int, ...] = (1, 2), folder: Path | None = None) -> None:
        self.camera = camera
        self.sizes = sizes
        self.folder = folder


class Forgetful:
    def __init__(self, size: int) -> None:
        self.length = size


def test_objects_are_described_with_their_defaults_and_made_again() -> None:
    component = Component(Camera(), folder=Path("a/b"))
    description = describe(component)
    assert description == {
        "_target_": "tests.test_recipe.Component",
        "camera": {"_target_": "tests.test_recipe.Camera", "focal": 2.0},
        "sizes": [1, 2],
        "folder": "a/b",
    }
    assert json.loads(json.dumps(description)) == description
    again = instantiate(description)
    assert isinstance(again, Component)
    assert again.camera == Camera()
    assert describe(again) == description


def test_shipped_components_are_made_again() -> None:
    slic = instantiate(describe(Slic(n_segments=64)))
    assert vars(slic) == vars(Slic(n_segments=64))
    builder = instantiate(describe(GraphBuilder(bounding_box_pairs)))
    label_map = np.int32([[0, 0, 1], [2, 2, 1]])
    assert np.array_equal(builder.adjacency(label_map), bounding_box_pairs(label_map))


def measure(frame: object, adjacency: object = border_pairs, names: tuple[str, ...] = ("a",)) -> None:
    """A component that is a function."""


def test_functions_and_their_partials_are_described_alike() -> None:
    bare = describe(measure)
    assert bare == {
        "_target_": "tests.test_recipe.measure",
        "_partial_": True,
        "adjacency": {"_target_": "sgbd.adjacency.border_pairs", "_partial_": True},
        "names": ["a"],
    }
    assert describe(functools.partial(measure, adjacency=border_pairs)) == bare
    assert describe(functools.partial(measure, adjacency=bounding_box_pairs)) != bare
    assert describe(functools.partial(Grid, 3)) == {"_target_": "tests.boxes.Grid", "_partial_": True, "size": 3}


@pytest.mark.parametrize(
    ("component", "message"),
    [
        (Forgetful(3), r"thing: Forgetful does not keep its argument 'size'.*Set self\.size"),
        (lambda frame: frame, "thing: .*no importable name"),
        (Grid().__call__, "thing: .*no importable name"),
        (Component(Camera(float("nan"))), r"thing\.camera\.focal: nan cannot be written down"),
        (functools.partial(Grid, length=3), "does not take the arguments of its partial"),
    ],
)
def test_what_cannot_be_described_is_an_error(component: object, message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        describe(component, "thing")


def test_values_become_plain() -> None:
    component = Component(Camera(np.float32(0.5)), sizes=np.array([3, 4]), folder={2: {"b", "a"}})  # type: ignore[arg-type]
    assert describe(component) == {
        "_target_": "tests.test_recipe.Component",
        "camera": {"_target_": "tests.test_recipe.Camera", "focal": 0.5},
        "sizes": [3, 4],
        "folder": {"2": ["a", "b"]},
    }


def test_the_hash_follows_everything_that_matters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_boxes(tmp_path / "a", 1)
    write_boxes(tmp_path / "a", 1, "test")
    write_boxes(tmp_path / "b", 1)

    def digest(source: Boxes, superpixels: Any = None, graph: Any = None) -> str:
        return recipe_hash(graph_recipe(source, superpixels or Grid(), graph or GraphBuilder()))

    source = Boxes(tmp_path / "a")
    reference = digest(source)
    assert digest(Boxes(tmp_path / "a")) == digest(Boxes(tmp_path / "a", "test")) == reference
    others = [
        digest(Boxes(tmp_path / "b")),
        digest(source, superpixels=Grid(5)),
        digest(source, graph=GraphBuilder(bounding_box_pairs)),
    ]
    for name, value in (("category_names", ("mug",)), ("seen", frozenset()), ("options", lambda: {"scale": 2})):
        changed = Boxes(tmp_path / "a")
        setattr(changed, name, value)
        others.append(digest(changed))
    for name, value in (
        ("FORMAT_VERSION", -1),
        ("VERSIONED_PACKAGES", ("numpy",)),
        ("NODE_GROUPS", {"rgb": ("red",)}),
        ("code_digest", lambda modules: "other code"),
    ):
        with monkeypatch.context() as context:
            context.setattr(sgbd.recipe, name, value)
            others.append(digest(source))
    assert len({reference, *others}) == 11
    assert digest(source) == reference


def test_the_folder_is_called_by_dataset_and_hash() -> None:
    recipe = {"dataset": {"name": "tod"}, "b": 1}
    assert folder_name(recipe) == f"tod-{recipe_hash(recipe)[:10]}"
    assert recipe_hash(dict(reversed(recipe.items()))) == recipe_hash(recipe)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Write a package of three modules: `first` imports `second`; `third` is independent."""
    folder = tmp_path / "some_package"
    folder.mkdir()
    (folder / "__init__.py").write_text("from some_package.second import value\n")
    (folder / "first.py").write_text("from . import value\nfrom .second import scale\nimport json\n\nx = value\n")
    (folder / "second.py").write_text('"""Two."""\nvalue = 1\n\n\ndef scale(a):\n    """Scale."""\n    return a * 2\n')
    (folder / "third.py").write_text("value = 3\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield folder
    for name in [name for name in sys.modules if name.startswith("some_package")]:
        del sys.modules[name]
    sgbd.recipe._digest_and_imports.cache_clear()


@pytest.mark.parametrize(
    ("file", "old", "new", "changes"),
    [
        ("first.py", "x = value", "x = 2", True),
        ("second.py", "a * 2", "a * 3", True),
        ("second.py", "Scale.", "Scale it.", False),
        ("second.py", "value = 1\n", "value = (  # one\n    1\n)\n", False),
        ("third.py", "3", "4", False),
    ],
)
def test_the_digest_follows_the_code_and_what_it_imports(
    package: Path, file: str, old: str, new: str, changes: bool
) -> None:
    def digest() -> str:
        sgbd.recipe._digest_and_imports.cache_clear()
        importlib.import_module("some_package.first")
        return code_digest(["some_package.first"])

    before = digest()
    assert digest() == before
    (package / file).write_text((package / file).read_text().replace(old, new))
    assert (digest() != before) is changes


def test_an_interactive_session_has_no_code_to_look_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "__main__", ModuleType("__main__"))
    with pytest.raises(RecipeError, match="interactive session"):
        code_digest(["__main__"])
