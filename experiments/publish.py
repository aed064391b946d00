"""Turn a finished sweep into a page of this folder, beside the paper's numbers.

    python experiments/publish.py outputs/sweeps/ablate_features [--note "Trained on …"]
    python experiments/publish.py outputs/feature_importance

It reads the sweep's records and writes experiments/<name>.md, <name>.csv and <name>.png; nothing is computed anew. Rows
that could not be run stand in the table as such. What stands below the line `<!-- remarks -->` of a page that is there
already is kept.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import pandas as pd
from omegaconf import OmegaConf
from paper import NOT_AT_HAND, PAPER_HM_OVERLAP_F
from remarks import with_remarks

from sgbd.sweep import read_jobs, summarize

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
}


def page(folder: Path, note: str, options: str = "") -> str:
    """Return the page of a sweep.

    Args:
        folder: The sweep's folder.
        note: A sentence on the circumstances.
        options: What the command had beside the experiment and the seeds.
    """
    name = folder.name
    jobs = read_jobs(folder)
    unfinished = jobs[~jobs["state"].isin(["finished", "not run"])]
    if len(unfinished):
        raise SystemExit(f"{folder}: {len(unfinished)} jobs are not finished; repeat the sweep, finished jobs are kept")
    summary = summarize(jobs)
    seeds = sorted(set(jobs["seed"]), key=int)
    dataset = OmegaConf.load(folder / jobs["folder"].iloc[0] / "config.yaml").dataset
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
        f"Dataset `{dataset.get('name', dataset['_target_'])}`: {_training_frames(folder, jobs)} training, "
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


def _training_frames(folder: Path, jobs: pd.DataFrame) -> str:
    """Say how many frames the jobs were trained on."""
    numbers = []
    for job in jobs["folder"]:
        dataset = OmegaConf.load(folder / job / "config.yaml").dataset
        available, most = dataset.get("train_frames"), dataset.get("max_train_frames")
        numbers.append("?" if available is None else str(available if most is None else min(available, most)))
    return " or ".join(dict.fromkeys(numbers))


def importance_page(folder: Path) -> str:
    """Return the page of the feature importance."""
    return "\n\n".join(
        [
            "# feature_importance",
            "```sh\npython -m sgbd.feature_importance\npython experiments/publish.py outputs/feature_importance\n```",
            (folder / "feature_importance.md").read_text().rstrip(),
            "![importances](feature_importance.png)",
        ]
    )


def main() -> None:
    """Write the page, the table and the figure of a sweep, or of the feature importance."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweep", type=Path, help="folder of the sweep")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    parser.add_argument("--options", default="", help="what the command had beside experiment and seeds")
    arguments = parser.parse_args()
    folder: Path = arguments.sweep
    if (folder / "feature_importance.csv").is_file():
        text = "\n\n".join(filter(None, [importance_page(folder), arguments.note])) + "\n"
        name, source = "feature_importance", "feature_importance"
    else:
        text, name, source = page(folder, arguments.note, arguments.options), folder.name, "table"
    target = HERE / f"{name}.md"
    target.write_text(with_remarks(text, target))
    for suffix in (".csv", ".png"):
        shutil.copyfile((folder / source).with_suffix(suffix), (HERE / name).with_suffix(suffix))
    print(target.read_text())


if __name__ == "__main__":
    main()
