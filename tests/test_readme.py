"""The documentation is valid: its commands, options, links and names exist."""

from __future__ import annotations

import ast
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from tests.jobs.test_configuration import CONF, composed

ROOT = CONF.parent
PAGES = {page: (ROOT / page).read_text() for page in ("README.md", "experiments/README.md")}
MADE_UP = {"mine", "mine_closed"}
"""Options that the reader creates, or that a command writes."""


def blocks(page: str, language: str) -> list[str]:
    """Return the code blocks of a page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL)


def typed(page: str) -> list[str]:
    """Return all shell commands on a page, one per item."""
    lines = "".join(blocks(page, "sh")).replace("\\\n", " ").splitlines()
    lines += re.findall(r"`((?:python|make) [^`]*)`", re.sub(r"^```.*?^```", "", PAGES[page], flags=re.M | re.S))
    return list(dict.fromkeys(line for line in lines if line.strip() and not line.startswith("#")))


def commands(start: str) -> list[tuple[str, ...]]:
    """Return the words of every command with the given start; placeholders are filled in."""
    found = [
        tuple(shlex.split(re.sub("…", "x", line), comments=True))
        for page in PAGES
        for line in typed(page)
        if line.startswith(start)
    ]
    return sorted(set(found))


def first_value(override: str) -> str:
    """Return the override of the first job if a range of values is swept over."""
    parsed = OverridesParser.create().parse_override(override)
    if not parsed.is_sweep_override():
        return override
    return f"{parsed.get_key_element()}={next(iter(parsed.sweep_string_iterator()))}"


@pytest.mark.parametrize("words", commands("python -m sgbd"), ids=" ".join)
def test_every_command_composes(words):
    entry = words[2].removeprefix("sgbd.")
    assert (ROOT / "sgbd" / f"{entry}.py").is_file()
    overrides = [word for word in words[3:] if word != "-m"]
    if entry == "report" and "=" not in overrides[0]:
        overrides[0] = f"folder={overrides[0]}"
    if "--config-dir" in overrides:  # an option file of the reader's own
        place = overrides.index("--config-dir")
        del overrides[place : place + 2]
        overrides = [override for override in overrides if override.partition("=")[2] not in MADE_UP]
    overrides = [first_value(override) for override in overrides]
    config = composed(entry, *overrides, hydra=True)
    for override in OverridesParser.create().parse_overrides(overrides):
        key, value = override.key_or_group, override.value()
        if override.is_sweep_override() or (CONF / key).is_dir() or key.startswith("hydra") or key == "experiment":
            continue  # a group's option is composed, or the composition fails
        found = OmegaConf.select(config, key)
        assert (OmegaConf.to_container(found) if OmegaConf.is_config(found) else found) == value


@pytest.mark.parametrize("words", commands("make "), ids=" ".join)
def test_every_target_of_make_exists(words):
    assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize("words", commands("python experiments/"), ids=" ".join)
def test_every_script_exists(words):
    assert (ROOT / words[1]).is_file()


@pytest.mark.parametrize("page", PAGES)
def test_every_option_exists(page):
    named = set(re.findall(r"[`\s+](experiment|[a-z_]+)=([a-z][a-z0-9_]*)\b(?![./:])", PAGES[page]))
    options = {(group, option) for group, option in named if (CONF / group).is_dir()}
    assert options
    missing = {
        f"{group}={option}"
        for group, option in options
        if option not in MADE_UP and not (CONF / group / f"{option}.yaml").is_file()
    }
    assert not missing


def test_the_table_of_groups_lists_every_option():
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", PAGES["README.md"], re.MULTILINE))
    for group in ("superpixels", "graph", "node_block", "model", "objectness", "sampler", "trainer", "partition"):
        shipped = {path.stem for path in (CONF / group).glob("*.yaml")}
        assert set(re.findall(r"`(\w+)`", rows[group])) == shipped
    shown = set(rows) | {"experiment", "hydra"}
    assert {path.name for path in CONF.iterdir() if path.is_dir()} <= shown


def anchors(page: str) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", page, flags=re.M | re.S), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = ROOT / (Path(page).parent / path if path else page)
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("block", blocks("README.md", "python"))
def test_every_name_of_the_examples_can_be_imported(block):
    imports = [node for node in ast.walk(ast.parse(block)) if isinstance(node, ast.ImportFrom)]
    for node in imports:
        module = import_module(node.module)
        for alias in node.names:
            assert hasattr(module, alias.name)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(sgbd(?:\.\w+)+)", PAGES["README.md"]))))
def test_every_name_in_the_text_exists(name):
    module, _, rest = name.rpartition(".")
    if (ROOT / name.replace(".", "/")).with_suffix(".py").is_file() or (ROOT / name.replace(".", "/")).is_dir():
        return
    assert hasattr(import_module(module), rest)
