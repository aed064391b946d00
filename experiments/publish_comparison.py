"""Turn the tables of python -m sgbd.compare into a page of this folder, beside the paper's numbers.

    python experiments/publish_comparison.py outputs/comparison/<time> --command "python -m sgbd.compare …" [--note "…"]

The page is called as the experiment: experiments/comparison.md, computational.md, real.md or qualitative.md, with the
CSV files and pictures that belong to it. Nothing is computed anew. What stands below the line `<!-- remarks -->` of a
page that is there already is kept.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import pandas as pd
from omegaconf import OmegaConf
from paper import PAPER_COST, PAPER_SCORES
from remarks import with_remarks

from sgbd.comparison import SHOWN

HERE = Path(__file__).resolve().parent
ON_TOD_Z = ("comparison",)
"""Experiments whose table has the paper's scores."""


def scores(folder: Path, name: str) -> str:
    """Return the table of scores, with the paper's rows where the experiment has them.

    Args:
        folder: Folder of the comparison.
        name: Of the experiment.
    """
    rows = pd.read_csv(folder / "comparison.csv", index_col="method")
    shown = {score: title for score, title in SHOWN.items() if score in rows}
    table = (100 * rows[list(shown)]).rename(columns=shown)
    table.insert(0, "frames", rows["frames"])
    if name in ON_TOD_Z:
        table = pd.concat([table, pd.DataFrame.from_dict(PAPER_SCORES, orient="index")[list(_of(table, PAPER_SCORES))]])
    cells = table.map(lambda value: "–" if pd.isna(value) else f"{value:.1f}")
    cells["frames"] = ["–" if pd.isna(value) else f"{value:.0f}" for value in table["frames"]]
    cells.index.name = "method"
    return cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))


def _of(table: pd.DataFrame, paper: dict[str, dict[str, float]]) -> list[str]:
    known = {title for row in paper.values() for title in row}
    return [title for title in table if title in known]


def costs(folder: Path) -> str:
    """Return the table of costs with the paper's row, and what it was measured on.

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
        f"cores others were computing too); one thread. {'; '.join(report['notes'])}. Medians; memory is the peak of a "
        "fresh process beyond its imports. Pre-processing is validation, superpixels and graph. Baselines have no "
        "parameters.\n\n" + cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))
    )


def failures(folder: Path) -> str:
    """Return the counts of failures by kind.

    Args:
        folder: Folder of the comparison.
    """
    table = pd.read_csv(folder / "failures.csv", index_col="method")
    return "Failures by kind (`sgbd.failures.classify_failures`):\n\n" + table.to_markdown()


def page(folder: Path, name: str, command: str, note: str) -> str:
    """Return the page of a comparison.

    Args:
        folder: Its folder.
        name: Of the experiment.
        command: What made it.
        note: A sentence on the circumstances.
    """
    config = OmegaConf.load(folder / "config.yaml")
    dataset = config.dataset
    made = f"outputs/{config.name}/<time>" + ("" if name == config.name else f" --name {name}")
    lines = [
        f"# {name}",
        f'```sh\n{command}\npython experiments/publish_comparison.py {made} --command "…"\n```',
        f"Dataset `{dataset.get('name', dataset['_target_'].rpartition('.')[2])}`.",
        note,
    ]
    if (folder / "comparison.csv").is_file():
        lines += ["Per cent.", scores(folder, name)]
    if (folder / "cost.json").is_file():
        lines.append(costs(folder))
    if (folder / "failures.csv").is_file():
        lines.append(failures(folder))
    pictures = sorted((folder / "pictures").glob("*.png"))
    lines += [f"![{picture.stem}](pictures/{name}_{picture.stem}.png)" for picture in pictures]
    return "\n\n".join(line for line in lines if line) + "\n"


def main() -> None:
    """Write the page, the tables and the pictures of a comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder that python -m sgbd.compare has written")
    parser.add_argument("--command", required=True, help="the command that made it, as others would type it")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    parser.add_argument("--name", help="of the page; by default that of the experiment")
    arguments = parser.parse_args()
    folder: Path = arguments.folder
    name = arguments.name or str(OmegaConf.load(folder / "config.yaml").name)
    target = HERE / f"{name}.md"
    target.write_text(with_remarks(page(folder, name, arguments.command, arguments.note), target))
    for table, suffix in (("comparison.csv", ""), ("failures.csv", "_failures"), ("cost.json", "_cost")):
        if (folder / table).is_file():
            shutil.copyfile(folder / table, HERE / f"{name}{suffix}{Path(table).suffix}")
    for picture in (folder / "pictures").glob("*.png"):
        shutil.copyfile(picture, HERE / "pictures" / f"{name}_{picture.name}")
    print(target.read_text())


if __name__ == "__main__":
    main()
