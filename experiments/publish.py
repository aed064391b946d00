"""Write a page in this folder about a finished sweep, next to the paper's numbers.

    python experiments/publish.py outputs/sweeps/ablate_features [--note "Trained on …"]
    python experiments/publish.py <earlier>/sweeps/ablate_features outputs/sweeps/ablate_features
    python experiments/publish.py outputs/feature_importance

It reads the records of the sweep and writes experiments/<name>.md, <name>.csv and <name>.png; nothing is recomputed.
Rows that could not be run are marked as such. If the page exists, its text below the line `<!-- remarks -->` is kept.
With several folders of one experiment, rows of later folders are added to or replace those of earlier ones.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from omegaconf import OmegaConf
from paper import NOT_AT_HAND, PAPER_HM_OVERLAP_F
from remarks import with_remarks

from sgbd.jobs.sweep import draw, read_jobs, summarize
from sgbd.reporting.runs import dataset_name
from sgbd.sources.categories import TOD_GROUPS

HERE = Path(__file__).resolve().parent
SHOWN = {
    "seen/overlap_f": "seen F",
    "unseen/overlap_f": "unseen F",
    "hm/overlap_f": "HM F",
    "hm/boundary_f": "HM boundary F",
    "oracle_hm/overlap_f": "HM F of the best partition",
    "all/overlap_f": "all F",
    "all/f75": "all F@.75",
    "unaided/overlap_f": "unaided F",
    "every category/overlap_f": "F of all categories",
    "never seen/overlap_f": "F of those no row saw",
    **{f"{group}/overlap_f": f"F of {group}" for group in TOD_GROUPS},
}
DRAWN = ("seen/overlap_f", "unseen/overlap_f", "hm/overlap_f", "all/overlap_f", "oracle/overlap_f")


def joined_jobs(folders: Sequence[Path]) -> pd.DataFrame:
    """Return the jobs of one or several sweeps of the same experiment.

    Args:
        folders: Folders of the sweeps; rows of later ones replace rows of earlier ones with the same overrides.

    Returns:
        The table of `sgbd.jobs.sweep.read_jobs` with the path of each job in an additional column `path`.

    Raises:
        SystemExit: If a sweep is unfinished, or the sweeps vary different options.
    """
    tables = []
    for folder in folders:
        jobs = read_jobs(folder)
        unfinished = jobs[~jobs["state"].isin(["finished", "not run"])]
        if len(unfinished):
            raise SystemExit(
                f"{folder}: {len(unfinished)} jobs are not finished; repeat the sweep, finished ones are kept"
            )
        jobs["path"] = [str(folder / job) for job in jobs["folder"]]
        tables.append(jobs)
    overrides = tables[-1].attrs["overrides"]
    for folder, jobs in zip(folders, tables, strict=True):
        if jobs.attrs["overrides"] != overrides:
            raise SystemExit(
                f"{folder} varies {jobs.attrs['overrides']}, {folders[-1]} {overrides}: two tables, not one"
            )
    kept: list[pd.DataFrame] = []
    for jobs in reversed(tables):
        later = {row for table in kept for row in table[overrides].itertuples(index=False, name=None)}
        again = [row in later for row in jobs[overrides].itertuples(index=False, name=None)]
        kept.insert(0, jobs[[not one for one in again]])
    joined = pd.concat(kept, ignore_index=True)
    scores = dict.fromkeys(score for jobs in tables for score in jobs.attrs["scores"])
    joined.attrs.update(overrides=overrides, scores=list(scores))
    return joined


def with_equal_categories(jobs: pd.DataFrame, groups: bool) -> list[str]:
    """Add scores that are comparable between jobs with different seen categories: means over the same categories.

    Args:
        jobs: Table of `joined_jobs`; the columns `every category/overlap_f` and, if there are categories that no job
            saw, `never seen/overlap_f` are added.
        groups: Whether to also add the mean over each of TOD-Z's four groups, as `<group>/overlap_f`.

    Returns:
        The categories that no job saw.
    """
    tables = [pd.read_csv(Path(path) / "categories.csv", index_col="category") for path in jobs["path"]]
    never = [name for name in sorted(tables[0].index) if not any(table["seen"].get(name, False) for table in tables)]
    f = pd.DataFrame([table["overlap_f_measure"] for table in tables], index=jobs.index)
    means = {"every category": list(f), **({"never seen": never} if never else {}), **(TOD_GROUPS if groups else {})}
    for name, categories in means.items():
        jobs[f"{name}/overlap_f"] = f[list(categories)].mean(axis=1)
        jobs.attrs["scores"].append(f"{name}/overlap_f")
    return never


def page(name: str, jobs: pd.DataFrame, note: str, options: str = "") -> str:
    """Return the page of a sweep as Markdown.

    Args:
        name: Name of the experiment.
        jobs: Table of `joined_jobs`.
        note: A sentence on the circumstances.
        options: Options of the command besides the experiment and the seeds.
    """
    if name.startswith("generalization"):
        never = with_equal_categories(jobs, groups=name == "generalization_groups")
        remark = "Seen and unseen are other categories in every row. The same in all rows are `all F`" + (
            ", `F of all categories` (their mean, without weights)"
            + (f" and that of those no row saw: {', '.join(never)}." if never else ". Every category is seen by a row.")
        )
        note = "\n\n".join(filter(None, [remark, note]))
    summary = summarize(jobs)
    seeds = sorted(set(jobs["seed"]), key=int)
    dataset = OmegaConf.load(Path(jobs["path"].iloc[0]) / "config.yaml").dataset
    varied = summary.attrs["overrides"]
    table = pd.DataFrame({key: summary[key].astype(str) for key in varied})
    for score, title in SHOWN.items():
        if score in summary:
            table[title] = [
                "not run" if pd.isna(mean) else f"{100 * mean:.1f}" + ("" if pd.isna(std) else f" ± {100 * std:.1f}")
                for mean, std in zip(summary[score], summary[f"{score} std"], strict=True)
            ]
    paper = PAPER_HM_OVERLAP_F.get(name)
    if paper and len(varied) == 1:
        values = [paper.get(str(value)) for value in summary[varied[0]]]
        table["HM F in the paper"] = ["–" if value is None else f"{value:.1f}" for value in values]
    command = " ".join(
        [f"python -m sgbd.train +experiment={name}", *filter(None, [options])]
        + ([f"seed={','.join(seeds)}"] if len(seeds) > 1 else [])
    )
    missing = jobs[jobs["state"] == "not run"]
    reasons = [str(reason).splitlines()[0] for reason in dict.fromkeys(missing["error"])]
    kind = f"conf/experiment/{name}.yaml"
    lines = [
        f"# {name}",
        f"```sh\n{command}\npython experiments/publish.py outputs/sweeps/{name}\n```",
        f"Dataset `{dataset_name(dataset)}`: {_training_frames(jobs)} training, "
        f"{dataset.get('val_frames', '?')} validation, {dataset.get('test_frames', '?')} test frames. Per cent"
        + (
            f"; mean ± sample standard deviation over the seeds {', '.join(seeds)}."
            if len(seeds) > 1
            else "; one seed: differences of a point or two are noise."
        )
        + (f" Which classes are meant: [{kind}](../{kind})." if "classes" in varied else ""),
        note,
        table.to_markdown(index=False, disable_numparse=True),
        "\n".join(["Not run:", "", *(f"- {reason}" for reason in reasons)]) if reasons else "",
        NOT_AT_HAND if name.startswith("generalization") else "",
        f"![scores]({name}.png)",
    ]
    return "\n\n".join(line for line in lines if line) + "\n"


def _training_frames(jobs: pd.DataFrame) -> str:
    """Return the number of training frames of the jobs as text."""
    numbers = []
    for job in jobs["path"]:
        dataset = OmegaConf.load(Path(job) / "config.yaml").dataset
        available, most = dataset.get("train_frames"), dataset.get("max_train_frames")
        numbers.append("?" if available is None else str(available if most is None else min(available, most)))
    return " or ".join(dict.fromkeys(numbers))


def importance_page(folder: Path) -> str:
    """Return the page about feature importance as Markdown."""
    return "\n\n".join(
        [
            "# feature_importance",
            "```sh\npython -m sgbd.feature_importance\npython experiments/publish.py outputs/feature_importance\n```",
            (folder / "feature_importance.md").read_text().rstrip(),
            "![importances](feature_importance.png)",
        ]
    )


def main() -> None:
    """Write the page, the table and the figure of a sweep or of the feature importance."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweeps", type=Path, nargs="+", help="folder of the sweep, or of several, the newest last")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    parser.add_argument("--options", default="", help="what the command had beside experiment and seeds")
    arguments = parser.parse_args()
    folders: list[Path] = arguments.sweeps
    if (folders[-1] / "feature_importance.csv").is_file():
        name = "feature_importance"
        text = "\n\n".join(filter(None, [importance_page(folders[-1]), arguments.note])) + "\n"
        for suffix in (".csv", ".png"):
            shutil.copyfile((folders[-1] / name).with_suffix(suffix), (HERE / name).with_suffix(suffix))
    else:
        name, jobs = folders[-1].name, joined_jobs(folders)
        text = page(name, jobs, arguments.note, arguments.options)
        jobs.drop(columns="path").to_csv(HERE / f"{name}.csv", index=False)
        summary = summarize(jobs)
        draw(summary, [score for score in DRAWN if score in summary]).savefig(HERE / f"{name}.png", dpi=150)
    target = HERE / f"{name}.md"
    target.write_text(with_remarks(text, target))
    print(target.read_text())


if __name__ == "__main__":
    main()
