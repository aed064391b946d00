"""The configured model before training, and its recipe."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.agglomeration import AgglomeratedGraph, digest_of
from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.features import EDGE_GROUPS, NODE_GROUPS, edge_columns, node_columns
from sgbd.jobs.configuration import ConfigurationError
from sgbd.node_block import NodeBlock, required_block, split_groups
from sgbd.own_columns import own_columns
from sgbd.recipe import describe

GROUPS = ("superpixels", "graph", "model", "objectness", "partition", "objects")
"""Configuration groups from which a checkpoint's recipe is made, besides the features."""

_AGGLOMERATED = f"{AgglomeratedGraph.__module__}.{AgglomeratedGraph.__qualname__}"


def untrained_checkpoint(config: DictConfig) -> Checkpoint:
    """Make the configured networks, with initial weights from PyTorch's global generator, and their recipe.

    Args:
        config: A configuration with `GROUPS` and `features` of conf/train.yaml.

    Returns:
        The untrained networks; the recipe contains everything that a `sgbd.segmenter.Segmenter` needs.

    Raises:
        ConfigurationError: If a first stage was trained on other superpixels.
        ValueError: If a feature group is unknown; the message lists the choices.
        sgbd.node_block.MissingWeightsError: If the features need a node block whose weights are missing.
    """
    features: dict[str, Any] = {
        "node": _groups(config.features.node, NODE_GROUPS),
        "edge": _groups(config.features.edge, EDGE_GROUPS),
    }
    graph = configured_graph(config)
    own = own_columns(graph)
    block = configured_block(config)
    stored, _ = split_groups(features["node"])
    nodes = (
        len(node_columns(stored)) + len(own.get("own_node_columns", ())) + (0 if block is None else len(block.names))
    )
    node_channels = {"node_channels": nodes}
    if block is not None:
        features["block"] = block.recipe()
    edge_channels = len(edge_columns(features["edge"])) + len(own.get("own_edge_columns", ()))
    channels = {**node_channels, "edge_channels": edge_channels}
    model = instantiate(config.model, **channels)
    has_head = config.objectness is not None
    recipe = {
        "superpixels": describe(instantiate(config.superpixels), "superpixels"),
        "graph": describe(graph, "graph"),
        "features": features,
        "model": {**_plain(config.model), **channels},
        "objectness": {**_plain(config.objectness), **node_channels} if has_head else None,
        "partition": _plain(config.partition),
        "objects": _plain(config.objects),
    }
    head = instantiate(config.objectness, **node_channels) if has_head else None
    first_stage: Checkpoint | None = getattr(graph, "checkpoint", None)
    if first_stage is not None:
        _check_superpixels(recipe["superpixels"], first_stage.recipe["superpixels"])
    return Checkpoint(model, head, recipe, first_stage)


def _check_superpixels(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
    """Reject superpixels on which the first stage was not trained; the number of threads does not affect them."""
    different = [key for key in sorted({*ours, *theirs} - {"threads"}) if ours.get(key) != theirs.get(key)]
    if different:
        changes = "; ".join(f"{key} was {theirs.get(key)}, now {ours.get(key)}" for key in different)
        raise ConfigurationError(
            f"the first stage was trained on other superpixels: {changes}. Choose the same ones for the second stage "
            "(superpixels=...)."
        )


def configured_graph(config: DictConfig) -> Any:
    """Return the configured graph builder.

    A first stage may be a checkpoint file or the folder of a training, and name classes of `trusted_packages`.

    Args:
        config: A configuration with `graph` and `output_dir`.

    Raises:
        sgbd.checkpoint.CheckpointError: If a first stage cannot be read.
    """
    first_stage = config.graph.get("first_stage")
    if config.graph._target_ != _AGGLOMERATED or not isinstance(first_stage, str):
        return instantiate(config.graph)
    trust = trusted_packages(config)
    checkpoint = Checkpoint.load(find_checkpoint(first_stage, config.output_dir), trust)
    graph: AgglomeratedGraph = instantiate(config.graph, first_stage=digest_of(checkpoint))
    graph.bind(checkpoint, trust)
    return graph


def configured_block(config: DictConfig) -> NodeBlock | None:
    """Return the configured node block if the configured features need it, else None.

    Args:
        config: A configuration with `features` and optionally `node_block`.

    Raises:
        sgbd.node_block.NodeBlockError: If a feature group is unknown.
    """
    chosen = config.get("node_block")
    return required_block(config.features.node, None if chosen is None else instantiate(chosen))


def trusted_packages(config: DictConfig) -> tuple[str, ...]:
    """Return the packages whose classes and functions a configuration names, because its author trusts them.

    Args:
        config: A configuration with `GROUPS`, and optionally `trust` for further packages.
    """
    chosen = (config.get(group) for group in (*GROUPS, "node_block"))
    targets = (target for group in chosen if group is not None for target in _targets(_plain(group)))
    return tuple(sorted({*(config.get("trust") or ()), *(target.partition(".")[0] for target in targets)}))


def _groups(chosen: Any, table: Mapping[str, Any]) -> list[str]:
    """Replace null by the names of all groups, so that a checkpoint stays valid when groups are added."""
    return list(table if chosen is None else chosen)


def _plain(config: DictConfig) -> dict[str, Any]:
    values = OmegaConf.to_container(config, resolve=True)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}


def _targets(values: Any) -> Iterator[str]:
    """Yield every `_target_`, including those nested in arguments."""
    if isinstance(values, Mapping):
        if "_target_" in values:
            yield str(values["_target_"])
        for value in values.values():
            yield from _targets(value)
    elif isinstance(values, list):
        for value in values:
            yield from _targets(value)
