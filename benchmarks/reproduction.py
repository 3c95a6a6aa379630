"""The tables of a full reproduction, as a page beside the published values.

    pourcast reproduce exp1 -o STUDY
    python -m benchmarks.reproduction STUDY > docs/reference/reproduction-exp1.md

Simulated observers answered, so the page shows what the analysis does with people whose heads
are known; what it says of the paper's people is only what the models alone can say.
"""

import argparse
from pathlib import Path

import pandas as pd

from pourcast.report.display import readable
from pourcast.report.page import with_published
from pourcast.study.experiments.exp1 import EXPERIMENT, PUBLISHED

COLUMNS = {
    "agreement": ["model", "r", "published r", "RMSE", "bias", "slope", "r with truth-water",
                  "r with truth-honey"],
    "reliability": ["liquid", "participants", "scenes", "split-half r", "with Spearman-Brown",
                    "noise ceiling (r)"],
    "choice": ["model", "N", "alpha", "zeta", "g", "m", "r", "as good as the best",
               "the paper's parameters", "r at the paper's"],
    "cross_validation": ["model", "r, all scenes", "r, training half", "r, other half",
                         "optimism"],
    "variance": ["model", "variance"],
    "variance_tests": ["model", "rival", "t", "df", "p"],
    "chance": ["liquid", "mean r", "beat chance (p < .05)", "participants", "KS D", "KS p"],
}  # fmt: skip


def markdown(table: pd.DataFrame, name: str) -> str:
    """A table of the study in Markdown."""
    text = readable(table)
    text = text[[column for column in COLUMNS[name] if column in text.columns]]
    lines = [list(text.columns), ["---"] * text.shape[1], *text.to_numpy().tolist()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path)
    folder = parser.parse_args().study / "report" / "tables"
    tables = {name: pd.read_csv(folder / f"{name}.csv") for name in COLUMNS}
    tables = {name: table.drop(columns="simulated") for name, table in tables.items()}
    published = with_published(tables["agreement"], EXPERIMENT)
    for liquid, rows in published.groupby("liquid", sort=False):
        print(f"\n### Correlation with simulated observers, {liquid} trials\n")
        print(markdown(rows, "agreement"))
    print("\n### Reliability\n")
    known = "; ".join(
        f"{liquid} {one.r:.2f} [{one.low:.2f}, {one.high:.2f}]"
        for liquid, one in PUBLISHED.split_half.items()
    )
    print(f"Published split-half correlations: {known}.\n")
    print(markdown(tables["reliability"], "reliability"))
    for name, title in (
        ("chance", "Single observers against chance"),
        ("choice", "Parameters chosen by the paper's procedure"),
        ("cross_validation", "Chosen on half of the scenes, scored on the other half"),
        ("variance", "Variance of deterministic judgments over the window of zeta"),
        ("variance_tests", "Unpaired t-tests between these variances"),
    ):
        print(f"\n### {title}\n")
        print(markdown(tables[name].fillna({"flat": "", "viscosity_alpha": "-"}), name))


if __name__ == "__main__":
    main()
