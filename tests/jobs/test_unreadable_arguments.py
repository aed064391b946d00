"""Advice on arguments that Hydra cannot read."""

from __future__ import annotations

import shlex

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from sgbd.jobs.unreadable_arguments import spellings


def test_a_bare_word_is_no_key_and_value() -> None:
    assert spellings(["my_folder"]) == ["my_folder is no key=value; --help lists the keys."]


@pytest.mark.parametrize("value", ["/tmp/scan (2).png", "a=b", "Größe/x.png", "it's", "{x", "back\\slash(s)"])
def test_the_advised_quotes_give_the_value(value: str) -> None:
    (told,) = spellings([f"rgb={value}", "depth=plain.png"])
    (argument,) = shlex.split(told.split(": ", 1)[1])
    override = OverridesParser.create().parse_override(argument)
    assert (override.key_or_group, override.value()) == ("rgb", value)


def test_what_can_be_read_is_passed_over() -> None:
    given = ["--config-dir", "my_conf", "-m", "--cfg=job", "+experiment=graph", "~logger", "seed=0,1", "x=[a,b]"]
    assert spellings(given) == []
