"""Turn a finished sweep into a page of this folder, beside the paper's numbers.

    python experiments/publish.py outputs/sweeps/ablate_features [--note "Trained on …"]

It reads the sweep's records and writes experiments/<name>.md, <name>.csv and <name>.png; nothing is computed anew.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import pandas as pd
from omegaconf import OmegaConf
from paper import NOT_RUN, PAPER_HM_OVERLAP_F

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


def page(folder: Path, note: str) -> str:
    """Return the page of a sweep.

    Args:
        folder: The sweep's folder.
        note: A sentence on the circumstances.
    """
    name = folder.name
    jobs = read_jobs(folder)
    unfinished = jobs[jobs["state"] != "finished"]
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
                f"{100 * mean:.1f}" + ("" if pd.isna(std) else f" ± {100 * std:.1f}")
                for mean, std in zip(summary[score], summary[f"{score} std"], strict=True)
            ]
    paper = PAPER_HM_OVERLAP_F.get(name)
    if paper and len(varied) == 1:
        values = [paper.get(str(value)) for value in summary[varied[0]]]
        table["HM F in the paper"] = ["–" if value is None else f"{value:.1f}" for value in values]
    command = f"python -m sgbd.train +experiment={name}" + (f" seed={','.join(seeds)}" if len(seeds) > 1 else "")
    lines = [
        f"# {name}",
        f"```sh\n{command}\npython experiments/publish.py outputs/sweeps/{name}\n```",
        f"Dataset `{dataset.get('name', dataset['_target_'])}`: {dataset.get('train_frames', '?')} training, "
        f"{dataset.get('val_frames', '?')} validation, {dataset.get('test_frames', '?')} test frames. Per cent"
        + (f"; mean ± sample standard deviation over the seeds {', '.join(seeds)}." if len(seeds) > 1 else "."),
        note,
        table.to_markdown(index=False, disable_numparse=True),
        NOT_RUN.get(name, ""),
        f"![scores]({name}.png)",
    ]
    return "\n\n".join(line for line in lines if line) + "\n"


def main() -> None:
    """Write the page, the jobs and the figure of a sweep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweep", type=Path, help="folder of the sweep")
    parser.add_argument("--note", default="", help="a sentence on the circumstances")
    arguments = parser.parse_args()
    folder: Path = arguments.sweep
    text = page(folder, arguments.note)
    (HERE / f"{folder.name}.md").write_text(text)
    shutil.copyfile(folder / "table.csv", HERE / f"{folder.name}.csv")
    shutil.copyfile(folder / "table.png", HERE / f"{folder.name}.png")
    print(text)


if __name__ == "__main__":
    main()
