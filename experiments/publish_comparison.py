"""Write a page in this folder with the tables of python -m sgbd.compare, next to the paper's numbers.

    python experiments/publish_comparison.py outputs/comparison/<time> --command "python -m sgbd.compare …" [--note "…"]
    python experiments/publish_comparison.py outputs/comparison/<earlier> outputs/comparison/<later> --command "…"

The page is named after the experiment: experiments/comparison.md, computational.md, real.md or qualitative.md, with its
CSV files and pictures. Nothing is recomputed. If the page exists, its text below the line `<!-- remarks -->` is kept.

With several folders, the row of a method in a later folder replaces that in an earlier one, so that a new model can be
added without repeating the baselines. All folders must be about the same frames.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig, OmegaConf
from paper import PAPER_COST, PAPER_SCORES
from remarks import with_remarks
from without_folders import without_folders

from sgbd.comparison_results import SHOWN
from sgbd.reporting.runs import dataset_name

HERE = Path(__file__).resolve().parent
ON_TOD_Z = ("comparison",)
"""Experiments whose table includes the paper's scores."""


def joined(folders: Sequence[Path], name: str) -> pd.DataFrame | None:
    """Join a table of several comparisons, one row per method.

    Args:
        folders: Folders of the comparisons; rows of later ones replace those of earlier ones.
        name: File name of the table.

    Returns:
        The table, with methods in order of first appearance; None if no folder has the table.
    """
    tables = [pd.read_csv(folder / name, index_col="method") for folder in folders if (folder / name).is_file()]
    if not tables:
        return None
    table = pd.concat(tables)
    order = dict.fromkeys(table.index)
    return table[~table.index.duplicated(keep="last")].loc[list(order)]


def scores(rows: pd.DataFrame, name: str) -> str:
    """Return the table of scores as Markdown, with the paper's rows if the experiment has them.

    Args:
        rows: Table `comparison.csv`.
        name: Name of the experiment.
    """
    shown = {score: title for score, title in SHOWN.items() if score in rows}
    table = (100 * rows[list(shown)]).rename(columns=shown)
    table.insert(0, "frames", rows["frames"])
    if name in ON_TOD_Z:
        table = pd.concat(
            [table, pd.DataFrame.from_dict(PAPER_SCORES, orient="index")[list(_columns_in_paper(table, PAPER_SCORES))]]
        )
    cells = table.map(lambda value: "–" if pd.isna(value) else f"{value:.1f}")
    cells["frames"] = ["–" if pd.isna(value) else f"{value:.0f}" for value in table["frames"]]
    cells.index.name = "method"
    return cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))


def _columns_in_paper(table: pd.DataFrame, paper: dict[str, dict[str, float]]) -> list[str]:
    known = {title for row in paper.values() for title in row}
    return [title for title in table if title in known]


def costs(folder: Path) -> str:
    """Return the table of costs as Markdown, with the paper's row and a description of the machine.

    Args:
        folder: Folder of the comparison.
    """
    report = json.loads((folder / "cost.json").read_text())
    table = pd.DataFrame(report["tables"]["cost"]["rows"]).set_index("method")
    table = pd.concat([table, pd.DataFrame.from_dict(PAPER_COST, orient="index")])
    machine = report["environment"]
    cells = table.map(lambda value: "–" if pd.isna(value) else f"{value:.0f}")
    cells.columns = [str(column).replace("_", " ") for column in cells]
    cells.index.name = "method"
    return (
        f"{machine['cpu']}, {machine['cores_used']} cores, load {machine['load']} at the start (above the number of "
        f"cores others were computing too). PyTorch has one thread, compiled loops have up to two. "
        f"{'; '.join(report['notes'])}. Medians; memory is the peak of a "
        "fresh process beyond its imports. Pre-processing is validation, superpixels and graph. Baselines have no "
        "parameters.\n\n" + cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))
    )


def failures(table: pd.DataFrame) -> str:
    """Return the table of failures by kind as Markdown.

    Args:
        table: Table `failures.csv`.
    """
    return "Failures by kind (`sgbd.failures.classify_failures`):\n\n" + table.to_markdown()


def same_frames(folders: Sequence[Path]) -> DictConfig:
    """Check that all comparisons use the same frames, and return the configuration of the last one.

    Args:
        folders: Folders of the comparisons.

    Raises:
        SystemExit: If they use different frames.
    """
    configs = [OmegaConf.load(folder / "config.yaml") for folder in folders]
    for folder, config in zip(folders, configs, strict=True):
        if (config.dataset, config.split) != (configs[-1].dataset, configs[-1].split):
            raise SystemExit(f"{folder} and {folders[-1]} are of different frames; their rows cannot stand together")
    assert isinstance(configs[-1], DictConfig)
    return configs[-1]


def page(folders: Sequence[Path], name: str, command: str, note: str) -> str:
    """Return the page of a comparison as Markdown.

    Args:
        folders: Folders of the comparison, newest last.
        name: Name of the page.
        command: Command that produced the comparison.
        note: A sentence on the circumstances.
    """
    config = same_frames(folders)
    times = " ".join([f"outputs/{config.name}/<time>"] * len(folders))
    made = times + ("" if name == config.name else f" --name {name}")
    lines = [
        f"# {name}",
        f'```sh\n{command}\npython experiments/publish_comparison.py {made} --command "…"\n```',
        f"Dataset `{dataset_name(config.dataset)}`.",
        note,
    ]
    rows, failure_table = joined(folders, "comparison.csv"), joined(folders, "failures.csv")
    if rows is not None:
        lines += ["Per cent.", scores(rows, name)]
    costly = [folder for folder in folders if (folder / "cost.json").is_file()]
    if costly:
        lines.append(costs(costly[-1]))
    if failure_table is not None:
        lines.append(failures(failure_table))
    pictures = sorted({picture.name: picture for folder in folders for picture in _pictures(folder)}.values())
    lines += [f"![{picture.stem}](pictures/{name}_{picture.name})" for picture in pictures]
    return "\n\n".join(line for line in lines if line) + "\n"


def _pictures(folder: Path) -> list[Path]:
    return sorted((folder / "pictures").glob("*.png"))


def main() -> None:
    """Write the page, the tables and the pictures of a comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="of python -m sgbd.compare, the newest last")
    parser.add_argument("--command", required=True, help="the command that made it, as others would type it")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    parser.add_argument("--name", help="of the page; by default that of the experiment")
    arguments = parser.parse_args()
    folders: list[Path] = arguments.folders
    name = arguments.name or str(OmegaConf.load(folders[-1] / "config.yaml").name)
    target = HERE / f"{name}.md"
    target.write_text(with_remarks(page(folders, name, arguments.command, arguments.note), target))
    for file, suffix in (("comparison.csv", ""), ("failures.csv", "_failures")):
        table = joined(folders, file)
        if table is not None:
            table.to_csv(HERE / f"{name}{suffix}.csv")
    for folder in folders:
        if (folder / "cost.json").is_file():
            cost = without_folders(json.loads((folder / "cost.json").read_text()))
            (HERE / f"{name}_cost.json").write_text(json.dumps(cost, indent=2) + "\n")
        for picture in _pictures(folder):
            shutil.copyfile(picture, HERE / "pictures" / f"{name}_{picture.name}")
    print(target.read_text())


if __name__ == "__main__":
    main()
