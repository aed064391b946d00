"""Write a file completely or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it holds either all of `content` or its previous content, even after a kill or a power cut.

    If several threads or processes write the file at the same time, even on different machines, the last one wins.

    Args:
        path: File to write; its folder is created if it does not exist.
        content: What to write.

    Raises:
        OSError: If the file cannot be written; the error names `path`, and no temporary file is left behind.
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
            # The system's error names the temporary file, or no file at all if the disk is full.
            error.filename = str(path)
        raise
