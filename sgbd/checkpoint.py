"""A trained model and its complete recipe in one file without executable content.

The file is in safetensors format. It stores the weights as tensors, and in the metadata one JSON text

    {"format": "sgbd checkpoint", "format_version": 1, "recipe": {...}}

The recipe describes how frames become graphs and graphs become segments, as configurations of classes (`_target_` and
arguments). Loading instantiates only classes of `sgbd` and of packages that the caller trusts.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

import safetensors
import safetensors.torch
import torch

from sgbd.machine.atomic_file import write_whole
from sgbd.models import EdgeClassifier, ObjectnessHead

log = logging.getLogger(__name__)

CHECKPOINT_FILE = "checkpoint.safetensors"
"""File name of the checkpoint in the folder of a training."""

PRETRAINED = "pretrained"
"""Stands for the model inside the package wherever a checkpoint's path is expected."""
PRETRAINED_FILE = Path(__file__).resolve().parent / "pretrained" / "sgbd.safetensors"
"""File of the model that is installed with the package."""

FORMAT = "sgbd checkpoint"
FORMAT_VERSION = 1
"""Increased whenever an older reader would misread the file."""

_METADATA = "sgbd"  # one key only: safetensors does not keep the order of keys, and equal checkpoints need equal files
_MODEL, _OBJECTNESS, _FIRST_STAGE = "model.", "objectness.", "first_stage."

Kind = TypeVar("Kind")


class CheckpointError(ValueError):
    """Raised if a checkpoint cannot be used; the message says what was given, what is expected and what to do."""


@dataclass
class Checkpoint:
    """Networks and their recipe.

    Attributes:
        model: The edge model.
        objectness: The objectness head, or None.
        recipe: JSON values. The sections `model` and `objectness` (null without a head) are the configurations that
            instantiate the modules, including `node_channels` and `edge_channels`. Other sections (superpixels, graph,
            features, partition, dataset, scores, versions) are stored unchanged.
        first_stage: For a second stage (`sgbd.agglomeration`), the model whose segments are the nodes of its graphs;
            stored in the same file.
    """

    model: EdgeClassifier
    objectness: ObjectnessHead | None = None
    recipe: dict[str, Any] = field(default_factory=dict)
    first_stage: Checkpoint | None = None

    def save(self, path: str | Path, *, half_precision: bool = False) -> Path:
        """Write the checkpoint atomically.

        Args:
            path: File to write, by convention `*.safetensors`.
            half_precision: Whether to round the weights to float16, which halves the file; loading
                makes them float32 again.

        Returns:
            The path.

        Raises:
            CheckpointError: If the recipe does not describe the modules, or contains values that are not JSON.
            OSError: If the file cannot be written.
        """
        path = Path(path)
        write_whole(path, self.to_bytes(half_precision=half_precision))
        return path

    def to_bytes(self, *, half_precision: bool = False) -> bytes:
        """Return the content of the file; arguments and errors as in `save`."""
        tensors, recipe = self._content(half_precision)
        try:
            header = json.dumps(
                {"format": FORMAT, "format_version": FORMAT_VERSION, "recipe": recipe},
                allow_nan=False,
                sort_keys=True,
            )
        except (TypeError, ValueError) as error:
            raise CheckpointError(
                f"the recipe must hold JSON values only ({error}); resolve a Hydra configuration with "
                "OmegaConf.to_container(config, resolve=True)"
            ) from error
        content: bytes = safetensors.torch.save(
            {key: value.detach().cpu().contiguous() for key, value in tensors.items()}, metadata={_METADATA: header}
        )
        return content

    def _content(self, half_precision: bool) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
        """Return the tensors and the recipe, including those of a first stage."""
        self._check_recipe()
        tensors = _tensors(self.model, _MODEL, half_precision)
        if self.objectness is not None:
            tensors |= _tensors(self.objectness, _OBJECTNESS, half_precision)
        if self.first_stage is None:
            return tensors, self.recipe
        first_tensors, first_recipe = self.first_stage._content(half_precision)
        tensors |= {f"{_FIRST_STAGE}{key}": value for key, value in first_tensors.items()}
        return tensors, {**self.recipe, "first_stage": first_recipe}

    def _check_recipe(self) -> None:
        for section, module in (("model", self.model), ("objectness", self.objectness)):
            config = self.recipe.get(section)
            if module is None and config is None:
                continue
            given = config.get("_target_") if isinstance(config, Mapping) else config
            if module is None or not isinstance(given, str) or given.rpartition(".")[2] != type(module).__name__:
                raise CheckpointError(
                    f"the recipe's section {section!r} is {given!r}, but the module to save is "
                    f"{'none' if module is None else type(module).__name__}. Put the configuration there that made it, "
                    "for example {'_target_': 'sgbd.models.SharedMLP', 'node_channels': 9, 'edge_channels': 0}."
                )

    @classmethod
    def load(cls, path: str | Path, trust: Sequence[str] = ()) -> Checkpoint:
        """Read a checkpoint.

        Args:
            path: File written by `save`.
            trust: Names of packages besides `sgbd` whose classes the recipe may name, for models of your own.

        Returns:
            The checkpoint; its modules are on the CPU and in evaluation mode.

        Raises:
            CheckpointError: If the file is missing, damaged, not a checkpoint, has another format version, names
                classes that are not trusted, or if its weights do not fit its recipe.
        """
        path = Path(path)
        recipe, tensors = _read(path)
        return cls._made(path, recipe, tensors, trust)

    @classmethod
    def _made(
        cls, path: Path, recipe: dict[str, Any], tensors: Mapping[str, torch.Tensor], trust: Sequence[str]
    ) -> Checkpoint:
        first_recipe = recipe.pop("first_stage", None)
        first_stage = None
        if isinstance(first_recipe, dict):
            own = {
                key.removeprefix(_FIRST_STAGE): value for key, value in tensors.items() if key.startswith(_FIRST_STAGE)
            }
            first_stage = cls._made(path, first_recipe, own, trust)
        try:
            model = instantiate(recipe.get("model"), EdgeClassifier, trust)  # type: ignore[type-abstract]
            objectness = None
            if recipe.get("objectness") is not None:
                objectness = instantiate(recipe["objectness"], ObjectnessHead, trust)
        except CheckpointError as error:
            raise CheckpointError(f"{path}: {error}") from error
        modules: list[tuple[str, torch.nn.Module]] = [(_MODEL, model)]
        if objectness is not None:
            modules.append((_OBJECTNESS, objectness))
        for prefix, module in modules:
            weights = {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}
            # A new module has PyTorch's default dtype, which the program may have changed for other networks. Weights
            # are stored in float32, or rounded to float16.
            for key, value in module.state_dict(keep_vars=True).items():
                if weights.get(key, value).dtype in (torch.float32, torch.float16):
                    value.data = value.data.float()
            try:
                module.load_state_dict(weights)
            except RuntimeError as error:
                raise CheckpointError(
                    f"{path}: the weights do not fit the recipe in the same file; it was changed, or written by "
                    f"another version of the model's class. {error}"
                ) from error
            module.eval()
        return cls(model, objectness, recipe, first_stage)

    def require(self, **sections: Any) -> None:
        """Check that graphs or frames were made with the recipe of this checkpoint.

        Args:
            **sections: Expected sections, for example `features={"node": [...], "edge": [...]}`.

        Raises:
            CheckpointError: If a section differs; the message lists all differences.
        """
        differences = [
            difference
            for section, value in sections.items()
            for difference in _differences(section, self.recipe.get(section), value)
        ]
        if differences:
            raise CheckpointError(
                f"checkpoint of another recipe: {'; '.join(differences)}. "
                "Prepare the graphs with the checkpoint's recipe, or train a model on these."
            )


def find_checkpoint(path: str | None, output_dir: str | Path) -> Path:
    """Find the file of a checkpoint.

    Args:
        path: A checkpoint file or the folder of a training; `PRETRAINED` for the model inside the package (write
            ./pretrained for a file or folder of that name); None for the newest checkpoint below `output_dir`.
        output_dir: The folder that contains the folders of trainings.

    Returns:
        The file. It is not opened; errors show when it is loaded.

    Raises:
        CheckpointError: If there is no checkpoint below `output_dir`, or the package was installed without its model.
    """
    if path == PRETRAINED:
        return pretrained_checkpoint()
    if path is not None:
        given = Path(path).expanduser()
        return given / CHECKPOINT_FILE if given.is_dir() else given
    found = sorted(Path(output_dir).rglob(CHECKPOINT_FILE), key=lambda file: file.stat().st_mtime)
    if not found:
        raise CheckpointError(
            f"there is no trained model in {output_dir}. Train one with python -m sgbd.train, or give "
            f"checkpoint=<file.safetensors>, or checkpoint={PRETRAINED} for the model that comes with the package"
        )
    log.info("Using the newest checkpoint: %s", found[-1])
    return found[-1]


def pretrained_checkpoint() -> Path:
    """Return the file of the model that is installed with the package.

    Raises:
        CheckpointError: If the package was installed without the model.
    """
    if not PRETRAINED_FILE.is_file():
        raise CheckpointError(
            f"this installation of sgbd has no pretrained model: {PRETRAINED_FILE} is missing. Install the package "
            "anew with pip, from a complete checkout or wheel, or give a model of your own: "
            "checkpoint=<file.safetensors>, Segmenter.load(<file.safetensors>)"
        )
    return PRETRAINED_FILE


def instantiate(config: Any, kind: type[Kind], trust: Sequence[str] = ()) -> Kind:
    """Instantiate an object from a configuration that was read from a file, and is therefore untrusted.

    It follows the rules of `hydra.utils.instantiate` for `_target_`, `_partial_` and nested configurations, but only
    instantiates classes that are defined in `sgbd` or in a trusted package. It never calls functions; a partial
    (`_partial_`) may refer to a function that is defined in such a package.

    Args:
        config: Mapping with `_target_` and arguments.
        kind: The class that the object must be an instance of; `object` accepts anything.
        trust: Names of trusted packages besides `sgbd`.

    Returns:
        The object.

    Raises:
        CheckpointError: If the class is missing, not trusted, not a subclass of `kind`, or rejects the arguments.
    """
    if not isinstance(config, Mapping) or not isinstance(config.get("_target_"), str):
        raise CheckpointError(f"the recipe names no class for a {kind.__name__}; got {config!r}")
    name = config["_target_"]
    target: Any = _resolve(name, trust)
    partial = config.get("_partial_", False) is True
    if not (inspect.isclass(target) or (partial and inspect.isfunction(target))):
        raise CheckpointError(f"the recipe names {name}, which is no class; a checkpoint must not call functions")
    if inspect.isclass(target) and not partial and not issubclass(target, kind):
        raise CheckpointError(f"the recipe names {name}, which is no {kind.__name__}")
    arguments = {
        key: _values(value, trust) for key, value in config.items() if key not in ("_target_", "_partial_", "_convert_")
    }
    if partial:
        return functools.partial(target, **arguments)  # type: ignore[return-value]
    try:
        return cast(Kind, target(**arguments))
    except (TypeError, ValueError) as error:
        raise CheckpointError(
            f"{name} cannot be made with the recipe's arguments ({error}); the checkpoint may be of another version"
        ) from error


def _tensors(network: torch.nn.Module, prefix: str, half_precision: bool) -> dict[str, torch.Tensor]:
    """Return the parameters and buffers of a network; buffers, such as moments of features, are never rounded."""
    state = network.state_dict()
    if half_precision:
        state |= {name: parameter.half() for name, parameter in network.named_parameters()}
    return {f"{prefix}{name}": value for name, value in state.items()}


def _values(value: Any, trust: Sequence[str]) -> Any:
    if isinstance(value, Mapping):
        if "_target_" in value:
            return instantiate(value, object, trust)
        return {key: _values(item, trust) for key, item in value.items()}
    if isinstance(value, list):
        return [_values(item, trust) for item in value]
    return value


def _resolve(name: str, trust: Sequence[str]) -> Any:
    trusted = tuple(dict.fromkeys(("sgbd", *([trust] if isinstance(trust, str) else trust))))

    def is_trusted(path: str) -> bool:
        return any(path == package or path.startswith(f"{package}.") for package in trusted)

    refusal = (
        f"the recipe names {name}, which is not in {' or '.join(trusted)}. If you trust where the file comes from, "
        f"name its package: trust={[name.partition('.')[0]]}."
    )
    if not is_trusted(name):
        raise CheckpointError(refusal)
    parts = name.split(".")
    target: Any = None
    for end in range(len(parts) - 1, 0, -1):
        module = ".".join(parts[:end])
        try:
            target = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not (module == error.name or module.startswith(f"{error.name}.")):
                raise CheckpointError(f"the recipe names {name}, which needs a missing package: {error}") from error
            continue
        try:
            for part in parts[end:]:
                target = getattr(target, part)
        except AttributeError:
            target = None
        break
    if target is None:
        raise CheckpointError(
            f"the recipe names {name}, which does not exist; the checkpoint may be of another version"
        )
    # A trusted module also contains what it imports: sgbd.training.os.system is not part of sgbd.
    if not is_trusted(getattr(target, "__module__", None) or ""):
        raise CheckpointError(refusal)
    return target


def _read(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise CheckpointError(
            f"{path} {what}; expected the file of a trained model, such as outputs/.../checkpoint.safetensors. "
            "Train one with python -m sgbd.train, or use the model that comes with the package: "
            f"checkpoint={PRETRAINED}, or Segmenter.pretrained()."
        )
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            header = metadata.get(_METADATA)
            tensors = {key: file.get_tensor(key) for key in file.keys()} if header else {}  # noqa: SIM118
    except (safetensors.SafetensorError, ValueError, RuntimeError) as error:
        raise CheckpointError(
            f"{path} cannot be read as a safetensors file ({error}): it is cut off, damaged, or something else. "
            "Copy it again, or train anew."
        ) from error
    if header is None:
        raise CheckpointError(
            f"{path} is a safetensors file without a recipe: bare weights or another program's. Expected a checkpoint "
            "of python -m sgbd.train."
        )
    try:
        content = json.loads(header)
        kind, version, recipe = content["format"], content["format_version"], content["recipe"]
    except (ValueError, LookupError, TypeError) as error:
        raise CheckpointError(
            f"{path}: its recipe is damaged ({error}). Copy the file again, or train anew."
        ) from error
    if kind != FORMAT or version != FORMAT_VERSION:
        raise CheckpointError(
            f"{path} is a {kind!r} of format version {version}; this version of sgbd reads version {FORMAT_VERSION}. "
            "Use the version of sgbd that wrote it, or train anew."
        )
    if not isinstance(recipe, dict):
        raise CheckpointError(f"{path}: its recipe is damaged (no mapping). Copy the file again, or train anew.")
    return recipe, tensors


def _differences(label: str, ours: Any, theirs: Any) -> list[str]:
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
        return [
            difference
            for key in sorted({*ours, *theirs})
            for difference in _differences(f"{label}.{key}", ours.get(key), theirs.get(key))
        ]
    if isinstance(theirs, tuple):
        theirs = list(theirs)
    return [] if ours == theirs else [f"{label} is {ours!r} in the checkpoint and {theirs!r} here"]
