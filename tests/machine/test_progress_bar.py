from __future__ import annotations

import io
import logging
import sys
from types import SimpleNamespace

import pytest
from omegaconf import OmegaConf

from sgbd.jobs.configuration import config_folder
from sgbd.machine import progress_bar
from sgbd.machine.progress_bar import ConsoleHandler, ProgressBar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_short_work_leaves_nothing_in_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(ProgressBar(range(3), "counting", mininterval=0)) == [0, 1, 2]
    assert capsys.readouterr().err == ""


def test_long_work_leaves_whole_lines_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    moments = iter(range(0, 1000, 20))
    monkeypatch.setattr(progress_bar, "time", SimpleNamespace(monotonic=lambda: next(moments)))
    with ProgressBar(total=4, desc="counting", mininterval=0, miniters=1) as bar:  # drawn at 20 seconds, ...
        for _ in range(4):
            bar.update()  # ... 40, 60, 80, 100
            bar.set_postfix_str("", refresh=False)
    lines = capsys.readouterr().err.splitlines()
    # And the last state when it is closed, at 120 seconds.
    assert [line.split("|")[2].split()[0] for line in lines] == ["1/4", "3/4", "4/4"]
    assert all(line.startswith("counting: ") for line in lines)


def test_a_terminal_sees_the_bar_move(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    list(ProgressBar(range(3), "counting", mininterval=0))
    assert sys.stderr.getvalue().count("\r") >= 4


def test_a_program_without_standard_error_works_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    monkeypatch.setattr(progress_bar, "INTERVAL", 0)
    assert list(ProgressBar(range(3), "counting", mininterval=0)) == [0, 1, 2]


def test_messages_stand_on_lines_of_their_own_above_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    log = logging.getLogger("test_progress_bar")
    log.addHandler(ConsoleHandler(sys.stderr))
    for _ in ProgressBar(range(2), "counting"):
        log.warning("noticed")
    log.handlers.clear()
    pieces = sys.stderr.getvalue().replace("\n", "\r").split("\r")
    assert pieces.count("noticed") == 2


def test_commands_log_through_it() -> None:
    handlers = OmegaConf.load(config_folder() / "hydra" / "job_logging" / "plain.yaml").handlers
    assert handlers.console["class"] == f"{ConsoleHandler.__module__}.{ConsoleHandler.__name__}"
