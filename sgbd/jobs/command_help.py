"""The page that --help prints: the current keys of a command, explained by the comments in the configuration."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

WIDTH = 100
COLUMN = 38
"""Column of the explanations; if a key is too long, its explanation begins on the next line."""
LONGEST_VALUE = 48
INDENT = "  "
"""Indentation of keys; the keys of an option are indented twice."""

_KEY = re.compile(r"(?P<indent> *)(?P<key>[A-Za-z_]\w*):(?= |$)(?P<value>.*?)(?: +# +(?P<beside>.*))?$")
_PACKAGE = "# @package"
_CLASS = re.compile(r"^_target_: .*$", re.MULTILINE)
_USAGE = re.compile(r"# {3}(?:\w+: )?python -m sgbd\.(?P<command>\w+)")


def explained_keys(text: str) -> tuple[str, dict[str, str]]:
    """Collect the comments above and beside the keys of a YAML file.

    Args:
        text: Content of the file.

    Returns:
        The purpose of the file, from the comments at its top without examples of commands; and the explanation of each
        key, by its full name.
    """
    lines = [line for line in text.splitlines() if not line.startswith(_PACKAGE)]
    top = next((place for place, line in enumerate(lines) if not line.startswith("#")), len(lines))
    explained: dict[str, str] = {}
    above: list[str] = []
    parents: list[tuple[int, str]] = []
    for line in lines[top:]:
        if line.lstrip().startswith("#"):
            above.append(line.lstrip("# "))
            continue
        match = _KEY.match(line)
        if match is not None:
            indent = len(match["indent"])
            parents = [parent for parent in parents if parent[0] < indent] + [(indent, match["key"])]
            explanation = " ".join([*above, match["beside"] or ""]).strip()
            if explanation:
                explained[".".join(key for _, key in parents)] = explanation
        above = []
    return " ".join(line.lstrip("# ") for line in lines[:top] if not _USAGE.match(line)), explained


def command_help(config: DictConfig) -> str:
    """Describe the keys of a command, its groups and their options.

    Args:
        config: The composed configuration of the command, with the node `hydra`.

    Returns:
        Lines of at most `WIDTH` characters, unless names are longer; `$` is doubled for `string.Template`.
    """
    hydra = config.hydra
    folders = [Path(source.path) for source in hydra.runtime.config_sources if source.schema == "file"]
    own_keys = [str(key) for key in config if key != "hydra"]
    values: Any = OmegaConf.to_container(OmegaConf.masked_copy(config, own_keys))
    purpose, explained = _read(folders, f"{hydra.job.config_name}.yaml")
    purpose = purpose.partition(": ")[2]
    groups = {}
    for choice, chosen in _choices(hydra.runtime.choices, values, folders).items():
        group, _, package = choice.partition("@")
        said = explained.get(choice, "" if len(chosen) < 2 else f"as many as there shall be: {choice}=[one,other]")
        prefix = "" if group == "experiment" else f"{package or group}."
        purposes: dict[str, str] = {}
        for option in chosen:
            purposes[f"{prefix}{option}"], known = explained_option(folders, group, option)
            explained |= {f"{prefix}{key}": words for key, words in known.items()}
        if len(chosen) == 1:
            (said,) = purposes.values()
        else:
            # Afterwards, because the file of one option may explain another's key.
            explained |= purposes
        groups[choice] = (chosen, said)
    own = {key: value for key, value in values.items() if key not in groups}
    page = textwrap.wrap(purpose[:1].upper() + purpose[1:], WIDTH)
    page += ["", "Keys (key=value; ??? is to be given):", *rows(own, "", explained)]
    if groups:
        page += ["", "Groups of options (group=option), each with the keys of the chosen option:"]
    for choice, (chosen, said) in groups.items():
        name = f"[{','.join(chosen)}]" if len(chosen) > 1 else chosen[0] if chosen else "null"
        page += ["", *_row(f"{choice}={name}", said)]
        others = [option for option in _options(folders, choice.partition("@")[0]) if option not in chosen]
        if others:
            page += textwrap.wrap(f"or {', '.join(others)}", WIDTH, initial_indent="    ", subsequent_indent=" " * 7)
        if isinstance(values.get(choice), dict):
            page += [INDENT + line for line in rows(values[choice], f"{choice}.", explained)]
    experiments = _experiments(folders, hydra.job.config_name)
    if experiments and "experiment" not in groups:
        page += ["", "Prepared experiments (+experiment=name):"]
        page += textwrap.wrap(", ".join(experiments), WIDTH, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(page).replace("$", "$$")


def _choices(choices: Mapping[str, Any], values: Mapping[str, Any], folders: Sequence[Path]) -> dict[str, list[str]]:
    """Return the chosen options of each group, in the order of the configuration.

    Hydra's choices lack groups with lists of options, so these are found by the keys of the configuration.
    """
    found = {group: sorted(value or ()) for group, value in values.items() if _options(folders, group)}
    for choice, option in choices.items():
        if not choice.startswith("hydra/"):
            found[choice] = [] if option is None else [option]
    return found


def explained_option(folders: Sequence[Path], group: str, option: str) -> tuple[str, dict[str, str]]:
    """Return the explanations of an option and of its keys.

    Keys are explained in the file of the option, of an option it is based on, or of another option with its class.

    Args:
        folders: Folders with configurations.
        group: The option's group.
        option: Its name.

    Returns:
        The purpose of the option, and the explanation of each key by its name within the group.
    """
    name = f"{group}/{option}.yaml"
    purpose, explained = _read(folders, name)
    text = _text(folders, name)
    if "defaults:" in text:
        for parent in OmegaConf.create(text).defaults:
            if isinstance(parent, str) and parent != "_self_":
                explained = explained_option(folders, group, parent)[1] | explained
    for other in _options(folders, group):
        alike = _text(folders, f"{group}/{other}.yaml")
        if _CLASS.findall(alike) == _CLASS.findall(text):
            explained = explained_keys(alike)[1] | explained
    return purpose, explained


def _text(folders: Sequence[Path], name: str) -> str:
    return next(((folder / name).read_text() for folder in folders if (folder / name).is_file()), "")


def _read(folders: Sequence[Path], name: str) -> tuple[str, dict[str, str]]:
    return explained_keys(_text(folders, name))


def _options(folders: Sequence[Path], group: str) -> list[str]:
    return sorted({path.stem for folder in folders for path in (folder / group).glob("*.yaml")})


def _experiments(folders: Sequence[Path], command: str) -> list[str]:
    """Return the experiments that are made for a command."""
    files = {path.stem: path for folder in folders for path in (folder / "experiment").glob("*.yaml")}
    examples = {name: _USAGE.search(path.read_text()) for name, path in sorted(files.items())}
    return [name for name, example in examples.items() if example is not None and example["command"] == command]


def rows(values: Mapping[str, Any], prefix: str, explained: Mapping[str, str]) -> Iterator[str]:
    """Generate the lines that show keys and their explanations.

    Args:
        values: Values of a configuration or of a part of it, by key.
        prefix: Prefix of the full names of these keys.
        explained: Explanations of keys, by full name.

    Yields:
        One or more lines per key. Mappings with explained keys are shown key by key, others as one value.
    """
    for key, value in values.items():
        name = f"{prefix}{key}"
        if key.startswith("_"):
            continue
        if isinstance(value, dict) and any(known.startswith(f"{name}.") for known in explained):
            if name in explained:
                yield from _row(name, explained[name])
            yield from rows(value, f"{name}.", explained)
        else:
            yield from _row(f"{name}={_shown(value)}", explained.get(name, ""))


def _row(key: str, explanation: str) -> list[str]:
    """Return the lines of a key, with its explanation in a separate column."""
    lines = textwrap.wrap(explanation, WIDTH - COLUMN - len(INDENT), break_long_words=False, break_on_hyphens=False)
    left = INDENT + key
    if not lines or len(left) > COLUMN - 2:
        return [left, *(" " * COLUMN + line for line in lines)]
    return [f"{left:{COLUMN}}{lines[0]}", *(" " * COLUMN + line for line in lines[1:])]


def _shown(value: Any) -> str:
    """Return a value as it would be typed on the command line, shortened if it is long."""
    if isinstance(value, dict):
        text = "{" + ", ".join(f"{key}: {_shown(item)}" for key, item in value.items() if key[:1] != "_") + "}"
    elif isinstance(value, list):
        text = "[" + ", ".join(map(_shown, value)) + "]"
    elif value is None or isinstance(value, bool):
        text = "null" if value is None else str(value).lower()
    else:
        text = str(value) or "''"
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 2].rstrip(' ,')} …"
