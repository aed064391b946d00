from __future__ import annotations

import logging

import pytest

from sgbd.sources.notices import info_once

log = logging.getLogger(__name__)


def test_a_notice_is_said_once_and_another_one_too(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        for _ in range(3):
            info_once(log, "%s has %d frames", "one", 1)
            info_once(log, "%s has %d frames", "one", 2)
    assert caplog.messages == ["one has 1 frames", "one has 2 frames"]


def test_a_notice_that_nobody_could_hear_is_not_used_up(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        info_once(log, "quiet")
    with caplog.at_level(logging.INFO):
        info_once(log, "quiet")
    assert caplog.messages == ["quiet"]
