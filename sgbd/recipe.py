"""The recipe of prepared graphs: everything they depend on except the contents of the frames, as JSON with a hash."""

from __future__ import annotations

import ast
import enum
import functools
import hashlib
import importlib
import inspect
import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from sgbd.features import EDGE_GROUPS, NODE_GROUPS
from sgbd.graph_file import FORMAT_VERSION
from sgbd.machine.compiled import HAS_NUMBA
from sgbd.own_columns import own_columns
from sgbd.sources.source import FrameSource

VERSIONED_PACKAGES = ("pillow", "scikit-image")
"""Packages whose results change between minor versions: Pillow decodes JPEG files, scikit-image provides SLIC."""

Recipe = dict[str, Any]


class RecipeError(ValueError):
    """Raised if a component cannot be recorded in a recipe; the message says what it needs."""


def graph_recipe(source: FrameSource, superpixels: object, graph: object) -> Recipe:
    """Return everything that the graphs of a dataset depend on, except the split and the contents of the files.

    Args:
        source: The frames of any split of the dataset.
        superpixels: Maps a frame to a label map.
        graph: Maps a frame and a label map to a graph.

    Returns:
        JSON values: the dataset, the configurations of both components (from which `hydra.utils.instantiate` recreates
        them), the feature groups and their columns, a digest of the code that builds the graphs, versions of packages,
        and the format version.

    Raises:
        RecipeError: If a component cannot be described.
    """
    root = getattr(source, "root", None)
    components = {"superpixels": describe(superpixels, "superpixels"), "graph": describe(graph, "graph")}
    options = _plain(source.options(), "the dataset's options")
    # The graphs of a second stage depend on the code of the first stage's networks.
    first_stage = getattr(getattr(graph, "checkpoint", None), "recipe", {})
    networks = [first_stage.get(section) for section in ("model", "objectness")]
    modules = [type(source).__module__, *_modules([components, options, networks])]
    return {
        "format_version": FORMAT_VERSION,
        "dataset": {
            "name": type(source).__name__.lower(),
            "root": None if root is None else str(Path(root).absolute()),
            "options": options,
            "category_names": list(source.category_names),
            "seen": sorted(source.seen),
        },
        **components,
        "node_groups": {group: list(names) for group, names in NODE_GROUPS.items()},
        "edge_groups": {group: list(names) for group, names in EDGE_GROUPS.items()},
        **own_columns(graph),
        "code": code_digest(modules),
        "versions": {package: _minor_version(package) for package in VERSIONED_PACKAGES},
        # Without Numba, scikit-image's SLIC replaces the compiled one.
        "compiled": HAS_NUMBA,
    }


def recipe_hash(recipe: Recipe) -> str:
    """Return a digest of a recipe: 64 hexadecimal digits, independent of the order of keys."""
    return hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()


def folder_name(recipe: Recipe) -> str:
    """Return the folder name for the graphs of a recipe: the dataset's name and ten digits of the hash."""
    return f"{recipe['dataset']['name']}-{recipe_hash(recipe)[:10]}"


def describe(component: object, label: str = "component") -> Any:
    """Return the configuration from which `hydra.utils.instantiate` recreates a component, including default values.

    A function, class or `functools.partial` becomes a partial. An object becomes its class with the arguments of its
    constructor, which it must store as attributes of the same names (like dataclasses and scikit-learn's estimators).

    Args:
        component: The component to describe.
        label: Name of the component in error messages.

    Returns:
        JSON values.

    Raises:
        RecipeError: If the component is a lambda or another local function, or does not store an argument.
    """
    if isinstance(component, functools.partial):
        target = inspect.unwrap(component.func)
        try:
            bound = inspect.signature(target).bind_partial(*component.args, **component.keywords)
        except TypeError as error:
            raise RecipeError(
                f"{label}: {_target(target, label)} does not take the arguments of its partial"
            ) from error
        return _partial(target, _flattened(bound), label)
    if inspect.isclass(component) or inspect.isroutine(inspect.unwrap(component)):  # type: ignore[arg-type]
        return _partial(inspect.unwrap(component), {}, label)  # type: ignore[arg-type]
    owner = type(component)
    arguments = {}
    for parameter in _parameters(owner):
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            continue
        if not hasattr(component, parameter.name):
            raise RecipeError(
                f"{label}: {owner.__qualname__} does not keep its argument {parameter.name!r}, so graphs made with it "
                f"cannot be told from others. Set self.{parameter.name} in its constructor, or make it a dataclass."
            )
        value = getattr(component, parameter.name)
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            arguments.update(value)
        else:
            arguments[parameter.name] = value
    return {
        "_target_": _target(owner, label),
        **{name: _plain(value, f"{label}.{name}") for name, value in arguments.items()},
    }


def code_digest(modules: Iterable[str]) -> str:
    """Return a digest of the code of modules and of what they import, at top level, from their own package.

    Comments, docstrings and layout do not affect it.

    Args:
        modules: Names of imported modules.

    Returns:
        16 hexadecimal digits.

    Raises:
        RecipeError: If a module is the main module of an interactive session, which has no file.
    """
    waiting, digests = list(modules), {}
    while waiting:
        name = waiting.pop()
        if name not in digests:
            digests[name], imports = _digest_and_imports(name)
            waiting.extend(imports)
    return hashlib.sha256(json.dumps(digests, sort_keys=True).encode()).hexdigest()[:16]


@functools.cache  # a process keeps running the code that it has loaded, even if the files change
def _digest_and_imports(name: str) -> tuple[str, tuple[str, ...]]:
    path = getattr(sys.modules.get(name) or importlib.import_module(name), "__file__", None)
    if path is None:
        if name == "__main__":
            raise RecipeError(
                "a component is defined in an interactive session, where a change of its code cannot be seen. "
                "Define it in a module file."
            )
        return "", ()  # built into the interpreter
    content = Path(path).read_bytes()
    if not path.endswith(".py"):
        return hashlib.sha256(content).hexdigest(), ()
    tree = ast.parse(content)
    imports = tuple(_imports_from_own_package(tree, name, is_package=Path(path).name == "__init__.py"))
    return hashlib.sha256(ast.dump(_without_docstrings(tree)).encode()).hexdigest(), imports


def _imports_from_own_package(tree: ast.Module, name: str, is_package: bool) -> Iterator[str]:
    family = name.partition(".")[0]
    package = name if is_package else name.rpartition(".")[0]
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] == family)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                origin = ".".join(
                    [*package.split(".")[: len(package.split(".")) - node.level + 1], *filter(None, [origin])]
                )
            if origin.partition(".")[0] == family:
                yield from (_home(origin, alias.name) for alias in node.names)


def _home(module: str, name: str) -> str:
    """Return the module that defines what `from module import name` imports, as packages re-export names."""
    if f"{module}.{name}" in sys.modules:
        return f"{module}.{name}"
    home = getattr(getattr(sys.modules.get(module), name, None), "__module__", None)
    return home if isinstance(home, str) and home.partition(".")[0] == module.partition(".")[0] else module


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [
                statement
                for statement in node.body
                if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant))
            ]
    return tree


def _partial(target: Any, given: Mapping[str, Any], label: str) -> Any:
    defaults = {
        parameter.name: parameter.default
        for parameter in _parameters(target)
        if parameter.default is not inspect.Parameter.empty
    }
    return {
        "_target_": _target(target, label),
        "_partial_": True,
        **{name: _plain(value, f"{label}.{name}") for name, value in {**defaults, **given}.items()},
    }


def _parameters(target: Any) -> Sequence[inspect.Parameter]:
    try:
        return list(inspect.signature(target).parameters.values())
    except (TypeError, ValueError):  # compiled code without a signature has no defaults to record
        return []


def _flattened(bound: inspect.BoundArguments) -> dict[str, Any]:
    arguments: dict[str, Any] = {}
    for name, value in bound.arguments.items():
        kind = bound.signature.parameters[name].kind
        arguments.update(value if kind is inspect.Parameter.VAR_KEYWORD else {name: value})
    return arguments


def _target(target: Any, label: str) -> str:
    module, name = getattr(target, "__module__", None), getattr(target, "__qualname__", "")
    if not module or not name or "<" in name or inspect.ismethod(target):
        raise RecipeError(
            f"{label}: {target!r} has no importable name, so graphs made with it cannot be told from others. Define it "
            "as a function or class at the top level of a module."
        )
    return f"{module}.{name}"


def _plain(value: Any, label: str) -> Any:
    """Convert an argument to JSON values."""
    if value is None or isinstance(value, bool | int | str):
        return value.value if isinstance(value, enum.Enum) else value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise RecipeError(f"{label}: {value} cannot be written down; give a finite number")
        return value
    if isinstance(value, np.generic):
        return _plain(value.item(), label)
    if isinstance(value, np.ndarray):
        return _plain(value.tolist(), label)
    if isinstance(value, enum.Enum):
        return _plain(value.value, label)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{label}.{key}") for key, item in value.items()}
    if isinstance(value, Set):
        return sorted((_plain(item, label) for item in value), key=json.dumps)
    if isinstance(value, Sequence):
        return [_plain(item, label) for item in value]
    return describe(value, label)


def _modules(description: Any) -> Iterator[str]:
    """Yield the module of every `_target_` in a description."""
    if isinstance(description, Mapping):
        if "_target_" in description:
            name = description["_target_"].rpartition(".")[0]
            # For a nested class or function, the module is further up.
            while name not in sys.modules and "." in name:
                name = name.rpartition(".")[0]
            yield name
        for value in description.values():
            yield from _modules(value)
    elif isinstance(description, list):
        for value in description:
            yield from _modules(value)


def _minor_version(package: str) -> str | None:
    try:
        return ".".join(version(package).split(".")[:2])
    except PackageNotFoundError:
        return None
