"""Write experiments/ablate_partition.md from evaluations of the same checkpoints with several partitioners.

    python -m sgbd.evaluate -m partition=components,multicut,… \\
        "checkpoint='outputs/sweeps/ablate_models/model=mlp/seed=0','…/seed=1',…"
    python experiments/publish_partitions.py outputs/evaluate/<time> --command "…" [--note "…"]

Checkpoints whose folders differ only in the last component (the seed) form one row. Nothing is recomputed. If the page
exists, its text below the line `<!-- remarks -->` is kept.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import OmegaConf
from publish import SHOWN
from remarks import with_remarks

HERE = Path(__file__).resolve().parent
NAME = "ablate_partition"


def option_of(partition: Any) -> str:
    """Return the name of the option in conf/partition that equals a partitioner's configuration.

    Args:
        partition: The configuration.

    Raises:
        SystemExit: If there is no such option.
    """
    for path in sorted((HERE.parent / "conf/partition").glob("*.yaml")):
        if OmegaConf.load(path) == partition:
            return path.stem
    raise SystemExit(f"no file of conf/partition is {OmegaConf.to_container(partition)}")


def read(folders: Sequence[Path]) -> pd.DataFrame:
    """Read evaluations.

    Args:
        folders: Folders of multiruns of `python -m sgbd.evaluate`.

    Returns:
        One row per evaluation: `trained` (folder of the checkpoint without the seed), `seed`, `partition`, all scores.
    """
    rows = []
    jobs = [job for folder in folders for job in sorted(folder.glob("[0-9]*"), key=lambda job: int(job.name))]
    for path in [job / "config.yaml" for job in jobs]:
        config = OmegaConf.load(path)
        checkpoint = Path(config.checkpoint)
        scores = json.loads((path.parent / "scores.json").read_text())
        rows.append(
            {
                "trained": checkpoint.parent.name,
                "seed": checkpoint.name,
                "partition": option_of(config.partition),
                **{key: float("nan") if value is None else value for key, value in scores.items()},
            }
        )
    return pd.DataFrame(rows)


def page(evaluations: pd.DataFrame, command: str, note: str) -> str:
    """Return the page as Markdown.

    Args:
        evaluations: Table returned by `read`.
        command: Command that produced the evaluations.
        note: A sentence on the circumstances.
    """
    groups = evaluations.groupby(["trained", "partition"], sort=False)
    rows = []
    for (trained, partition), group in groups:
        row: dict[str, Any] = {"trained": trained, "partition": partition, "seeds": str(len(group))}
        for score, title in SHOWN.items():
            if score in group:
                spread = f" ± {100 * group[score].std(ddof=1):.1f}" if len(group) > 1 else ""
                row[title] = f"{100 * group[score].mean():.1f}{spread}"
        rows.append(row)
    lines = [
        f"# {NAME}",
        f'```sh\n{command}\npython experiments/publish_partitions.py outputs/evaluate/<time> … --command "…"\n```',
        note,
        "Per cent; mean ± sample standard deviation over the trainings.",
        pd.DataFrame(rows).to_markdown(index=False, disable_numparse=True),
    ]
    return "\n\n".join(line for line in lines if line) + "\n"


def main() -> None:
    """Write the page and its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="folders of multiruns of python -m sgbd.evaluate")
    parser.add_argument("--command", required=True, help="the command that made them, as others would type it")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    arguments = parser.parse_args()
    evaluations = read(arguments.folders)
    target = HERE / f"{NAME}.md"
    target.write_text(with_remarks(page(evaluations, arguments.command, arguments.note), target))
    evaluations.to_csv(HERE / f"{NAME}.csv", index=False)
    print(target.read_text())


if __name__ == "__main__":
    main()
