"""What a reader needs to repeat a report: a paragraph of methods, and a table of its sources."""

import hashlib
import platform
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import pandas as pd

import pourcast
from pourcast.comparison.candidates import PAPER, is_fitted
from pourcast.comparison.choice import FITTED_HALVINGS
from pourcast.comparison.compare import Comparison
from pourcast.files import finished_files
from pourcast.report.numbers import engine_in_words, fields_in_words, liquid_in_words
from pourcast.scenes.liquids.registry import called
from pourcast.simulation.run import engine_version
from pourcast.simulation.settings import EngineSettings
from pourcast.statistics.jackknife import over_words
from pourcast.statistics.sampling import Sampling
from pourcast.study.chosen import CHOSEN_FILE
from pourcast.study.trials import Trials

ENGINE = EngineSettings()
"""What `comparison.compare` judges with: the settings as they come."""

LIBRARIES = ("numpy", "scipy", "pandas", "statsmodels", "numba", "matplotlib")


BAYES_LIBRARIES = ("numpyro", "jax", "arviz-stats")

SAMPLING = Sampling()
"""What `comparison.compare` draws of posteriors."""


def methods(comparison: Comparison) -> str:
    """A paragraph for a paper's methods section."""
    settings = comparison.settings
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    who = "The responses are those of simulated observers, not of people. "
    return (
        f"{who if comparison.simulated else ''}Judgments were compared with models by pourcast "
        f"{pourcast.__version__} (engine {engine_version()}; {libraries}; Python "
        f"{platform.python_version()}), which implements the models of Bates, Yildirim, "
        f"Tenenbaum, and Battaglia (2019). {_computed(comparison)}{_counts(comparison)} "
        f"{_exclusions(comparison)} "
        "Agreement is the Pearson correlation of participants' mean judgment of each scene with "
        f"the model's, with {100 * settings.level:g} % intervals over "
        f"{over_words(settings.over)} (jackknife standard errors of Fisher's z, Student's t); "
        "differences between models were tested in Fisher's z in the same way, with p values "
        "adjusted for all pairs of a liquid (Holm). "
        f"{_reliability(comparison)}{_chance(comparison)}{_choice(comparison)}{_bayes(comparison)}"
        f"The seed of all draws was {settings.seed}."
    )


def _computed(comparison: Comparison) -> str:
    """How pours were computed, and what their liquids are like; nothing if there were none."""
    if not comparison.pours:
        return ""
    liquids = "; ".join(
        f"{name} ({liquid_in_words(numbers)})" for name, numbers in _liquids(comparison)
    )
    swept = "".join(
        f"Judgments of the sweep {name!r} were computed with {fields_in_words(changed)}. "
        for name, changed in comparison.judged.engines.items()
    )
    return f"{engine_in_words(ENGINE, comparison.pours)} The liquids are {liquids}. {swept}"


def _liquids(comparison: Comparison) -> list[tuple[str, dict[str, float]]]:
    """Names and numbers of the liquids that were poured in models' heads."""
    poured = [pour.liquid for pour in comparison.pours if pour.kind == "liquid"]
    found: list[tuple[str, dict[str, float]]] = []
    for liquid in poured:
        if (one := (liquid.name, liquid.engine_identity)) not in found:
            found.append(one)
    return found


def _reliability(comparison: Comparison) -> str:
    """How reliability was had, if it was."""
    table = comparison.tables.get("reliability", pd.DataFrame())
    if "ceiling" not in table or not table["ceiling"].notna().any():
        return ""
    return (
        "Split-half reliability is the mean over 1,000 random halves of the participants; the "
        "noise ceiling is the root of the reliability of the mean judgments, without what can't "
        "lower a correlation; intervals of both, and of the share of explainable variance, are "
        "over scenes. "
    )


def _chance(comparison: Comparison) -> str:
    """How single participants were compared with chance, if they were."""
    if "chance" not in comparison.tables:
        return ""
    return (
        "Single participants were compared with responses to the same scenes drawn from a beta "
        "distribution fitted by moments to all responses (10,000 draws; two-sample "
        "Kolmogorov-Smirnov test), and all together with 10,000 permutations of the scenes. "
    )


def _choice(comparison: Comparison) -> str:
    """How parameters were chosen, if they were."""
    if "choice" not in comparison.tables:
        return ""
    models = set(comparison.tables["choice"]["model"])
    ways = [
        *(
            ["stage by stage (number of particles, viscosity, damping)"]
            if models & set(PAPER)
            else []
        ),
        *(["all together"] if models - set(PAPER) else []),
    ]
    sentences = [f"Parameters were chosen by correlation with people, {' or '.join(ways)}"]
    if "cross_validation" in comparison.tables:
        sentences.append("the choice was cross-validated on random halves of the scenes")
    if any(is_fitted(name) for one in comparison.compared for name in one.names):
        sentences.append(
            "for the comparison with other models, each half of the scenes was judged with the "
            "parameters that were chosen on the other half (of "
            f"{FITTED_HALVINGS} random halvings the one of median r)"
        )
    return f"{'; '.join(sentences)}. "


def _bayes(comparison: Comparison) -> str:
    """How the likelihood of single answers was had, if it was."""
    if "posterior" not in comparison.tables:
        return ""
    loo = comparison.tables.get("loo", pd.DataFrame({"unit": [], "refitted": []}))
    left_out = [
        f"{unit} were left out one at a time, with their effects integrated out (Pareto-smoothed "
        f"importance sampling; {rows['refitted'].sum()} fits without one of them where Pareto k "
        "was high)"
        for unit, rows in loo.groupby("unit", sort=False)
    ]
    libraries = ", ".join(f"{name} {version(name)}" for name in BAYES_LIBRARIES)
    effect = (
        "People's sensitivity to the liquid is their slope on the difference between a model's "
        "judgments of both, in a model of both liquids with effects of participants and scenes on "
        "that difference. "
    )
    return (
        "Single answers were fitted by ordered beta regression with normal effects of "
        "participants (intercept and slope) and of scenes (intercept), by NUTS with "
        f"{SAMPLING.chains} chains of {SAMPLING.warmup} + {SAMPLING.draws} draws ({libraries})"
        f"{''.join(f'; {part}' for part in left_out)}. "
        f"Each fit was checked by answers made from it (posterior predictive checks: "
        f"{SAMPLING.replicates:,} data sets of the same participants and scenes, and as many of "
        "new ones), and how far its parameters depend on their priors by power-scaling. "
        f"{effect if 'liquid_effect' in comparison.tables else ''}"
    )


def _counts(comparison: Comparison) -> str:
    counts = [
        f"{_people(one.trials)} {len(one.trials.scenes)} scenes of {called(one.trials.liquid)}"
        for one in comparison.compared
    ]
    repeated = any(one.trials.occasions is not None for one in comparison.compared)
    mean = " Answers of a participant to the same scene were averaged." if repeated else ""
    return f"{'; '.join(counts)}.{mean}"


def _people(trials: Trials) -> str:
    count = trials.participant_count
    return (
        f"{count} participants judged" if count else "Only means were known of people's answers to"
    )


def _exclusions(comparison: Comparison) -> str:
    if not comparison.exclusions:
        return "No participants or trials were excluded."
    rules = [
        f"{one.rule} ({len(one.participants)} participants, {one.trials} trials)"
        for one in comparison.exclusions
    ]
    return f"Excluded were, by rule: {'; '.join(rules)}."


def provenance(comparison: Comparison) -> list[tuple[str, str]]:
    """Everything that the report was made from: versions, seeds, files and their digests."""
    path, digest = comparison.source
    settings, study = comparison.settings, comparison.study
    rows = [
        ("pourcast", pourcast.__version__),
        ("engine", engine_version()),
        ("Python", platform.python_version()),
        *((name, version(name)) for name in LIBRARIES),
        *((name, version(name)) for name in BAYES_LIBRARIES if "posterior" in comparison.tables),
        ("seed of random draws", str(settings.seed)),
        ("intervals and tests", f"over {over_words(settings.over)}"),
        (f"responses: {path.name}", f"sha256 {digest}"),
    ]
    if mapping := comparison.columns:
        known = mapping.endswith(".toml")
        said = f"{Path(mapping).name}: sha256 {_sha256(Path(mapping))}" if known else mapping
        rows += [("columns of the responses", said)]
    if comparison.pours:
        rows += [("engine settings", fields_in_words(asdict(ENGINE)))]
        rows += [(name, fields_in_words(numbers)) for name, numbers in _liquids(comparison)]
        rows += [
            (f"engine settings of the sweep {name}, where others", fields_in_words(changed))
            for name, changed in comparison.judged.engines.items()
        ]
    files = [study / name for name in ("study.toml", CHOSEN_FILE, "scenes.json")]
    files += finished_files(study / "judgments")
    grids = finished_files(study / "sweep" / "grids", "*.toml")
    files += [file for file in grids if (study / "judgments" / f"{file.stem}.parquet").exists()]
    rows += [
        (str(file.relative_to(study)), f"sha256 {_sha256(file)}")
        for file in files
        if file.is_file()
    ]
    return rows


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
