"""python -m sgbd.export: export a trained model as an ONNX file, for programs without Python."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.jobs.configuration import ConfigurationError, entry_point
from sgbd.machine.atomic_file import write_whole
from sgbd.onnx_export import Check, check, input_names, output_names, to_onnx

log = logging.getLogger(__name__)

MODEL_FILE = "model.onnx"


@entry_point("export")
def main(config: DictConfig) -> None:
    """Export the networks, check them against PyTorch, write the files, and print agreement and speed."""
    if not isinstance(config.repeats, int) or config.repeats < 0:
        raise ConfigurationError(f"repeats must be an integer of at least 0; got {config.repeats!r}")
    if not isinstance(config.output, str) or not config.output:
        raise ConfigurationError(f"output must be a file such as {MODEL_FILE}, or a folder; got {config.output!r}")
    trust = tuple(config.trust)
    source = find_checkpoint(config.checkpoint, config.output_dir)
    path = Path(config.output).expanduser()
    stages = files_of_stages(Checkpoint.load(source, trust), path / MODEL_FILE if path.is_dir() else path)
    checked = []
    # Check both stages before writing either, because one is useless without the other.
    for file, checkpoint in stages.items():
        log.info(
            "Exporting %s with the inputs %s and the outputs %s in ONNX opset %s",
            type(checkpoint.model).__name__,
            ", ".join(input_names(checkpoint)),
            ", ".join(output_names(checkpoint)),
            config.opset,
        )
        content = to_onnx(checkpoint, config.opset, trust)
        checked.append((file, content, check(checkpoint, content, repeats=config.repeats)))
    for file, content, checks in checked:
        write_whole(file, content)
        print(f"\n{file}, {len(content) / 1e6:.2f} MB:\n\n{table(checks)}")
    print("\nDifferences are those of the logits s from PyTorch's, as a share of 1 + |s|; times are on one thread.")


def files_of_stages(checkpoint: Checkpoint, path: Path) -> dict[Path, Checkpoint]:
    """Return the output file of each stage of a checkpoint.

    Args:
        checkpoint: A model, with its first stage if it has one.
        path: File of the model.

    Returns:
        The checkpoint to write to each file: `path` for the model, and `model.first_stage.onnx` beside `model.onnx` for
        its first stage.
    """
    files = {path: checkpoint}
    if checkpoint.first_stage is not None:
        beside = path.with_name(f"{path.stem}.first_stage{path.suffix}")
        files |= files_of_stages(checkpoint.first_stage, beside)
    return files


def table(checks: Sequence[Check]) -> str:
    """Return the agreement and the speed on each graph as a Markdown table."""
    rows = []
    for row in checks:
        cells = {"nodes": str(row.nodes), "pairs": str(row.pairs), "largest difference": f"{row.difference:.1e}"}
        if row.torch is not None and row.onnx is not None:
            cells |= {
                "PyTorch ms": f"{row.torch.median:.2f}",
                "ONNX Runtime ms": f"{row.onnx.median:.2f}",
                "times as fast": f"{row.torch.median / row.onnx.median:.2f}",
            }
        rows.append(cells)
    shown: str = pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True, stralign="right")
    return shown


if __name__ == "__main__":
    main()
