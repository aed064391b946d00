"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it holds all of `content` or what it held before, even after a kill or a power cut.

    Of several threads or processes that write one file at a time, on whatever machines, the last one's content stays.

    Args:
        path: File to write; its folder is made if it isn't there.
        content: What to write.

    Raises:
        OSError: If it cannot be written; it names `path`, and nothing is left behind.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            # The system names no file where the disk is full, and the temporary one elsewhere.
            error.filename = str(path)
        raise
