"""Whether a conclusion stands however the data are analysed: every defensible way at once.

Which participants are excluded, by what models are measured, and what a conclusion is to hold over
are choices that others would have made otherwise. All of them together are a multiverse (Steegen,
Tuerlinckx, Gelman & Vanpaemel 2016, Perspectives on Psychological Science 11); a conclusion that
hangs on one of them is shown to.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
import pandas as pd

from pourcast.comparison import agreement, stimulus
from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.matching import ComparisonOptions, StudyTrials, match_study, study_trials
from pourcast.errors import InputError, unknown
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import agreement as measured
from pourcast.statistics.correlation import mean_judgments
from pourcast.statistics.differences import NEARER, PairMeasure, compare_pairs, holm
from pourcast.statistics.jackknife import Over, unknowable
from pourcast.statistics.sampling import Sampling

NO_RULE = "nobody"
"""What is excluded where no rule is."""

LIKELIHOOD = "likelihood"
"""The measure of single answers, beside those of `PairMeasure`."""

MOST_RULES = 5
"""Of exclusion, each of which is applied and not applied with all others."""

FINDINGS = ("told nearer", "nearer", "farther", "told farther", "unknown")
"""What an analysis finds of the model that is claimed to be nearest, beside another one."""

TABLES = {
    "analyses": "Analyses: the nearest model, and from how many others the claimed one is told",
    "choices": "Which choice the conclusion hangs on",
    "findings": "The claimed model beside each other one, in each analysis",
    "chance": "Participants against chance, by ground truth",
}
"""Tables of a multiverse, and what they say."""


@dataclass(frozen=True)
class Multiverse:
    """All analyses of a study.

    Parameters
    ----------
    simulated
        Whether any of the responses are simulated.
    answers
        Whether the conclusion stands; a line a liquid.
    remarks
        What else a reader should know.
    tables
        Name -> table; see `TABLES`.

    Notes
    -----
    `findings` has a row an analysis and other model: `liquid`, `claim` (the model that is claimed
    to be nearest), `exclusions`, `participants`, `scenes`, `measure`, `over`, `rival`, `difference`
    (positive where the claimed model is nearer), `low`, `high` (of r and RMSE), `p`, `p_holm` (for
    all pairs of the analysis) and `finding`, one of `FINDINGS`. `analyses` counts them: `best` (the
    model that is nearest), `told_nearer`, `told_farther`, `rivals`. `choices`: for each option of
    a choice the share of analyses in which the claimed model is `nearest`, and the mean share of
    the others from which it is told (`told_from`).
    """

    simulated: bool
    answers: tuple[str, ...]
    remarks: tuple[str, ...]
    tables: dict[str, pd.DataFrame]


class _Analysis(NamedTuple):
    """One way to analyse the trials of one liquid.

    `pairs`: `model`, `rival`, `difference` (positive where the model is nearer), `low`, `high`, `p`
    and `p_holm`.
    """

    liquid: str
    exclusions: str
    participants: int
    scenes: int
    measure: str
    over: str
    best: str
    pairs: pd.DataFrame


def study_multiverse(
    study: Path, options: ComparisonOptions, claim: str = "", report: Report = no_report
) -> Multiverse:
    """Compare a study's models with people in every way that could be defended.

    Exclusions (each rule applied and not applied, with all others) x measure (r, RMSE; with
    `options.bayes` the likelihood of single answers) x what a conclusion holds over. Parameters of
    fitted models are chosen anew for each; ground truths are among the models.

    Parameters
    ----------
    study
        The study folder.
    options
        What is compared. Its rules of exclusion are those that are tried; without any, the usual
        ones as far as they fit (`usual_rules`). The main analysis excludes by all the rules that
        are given, and measures r over `options.settings.over`.
    claim
        The model that is claimed to be nearest to people; by default, for each liquid, the one
        that is nearest in the main analysis.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study, the responses, a rule or a model is wrong.
    StoreError
        If judgments could not be made.
    """
    settings = options.settings
    rule_sets, main, said = _rule_sets(study, options)
    analyses: list[_Analysis] = []
    chances: list[pd.DataFrame] = []
    remarks: dict[str, None] = dict.fromkeys(said)
    for done, rules in enumerate(rule_sets):
        words = _words(rules)
        report(f"excluded: {words}", done, len(rule_sets))
        found = match_study(study, replace(options, exclude=rules))
        for one in found.people:
            analyses += _by_answers(one, words, settings)
            if options.bayes:
                analyses += _by_likelihood(one, words, settings, report)
            remarks |= dict.fromkeys(_unknown(one, words))
            chances += [_against_each_truth(one, words, settings)]
    if not analyses:
        raise InputError(f"{found.read.path}: {'; '.join(remarks)}")
    remarks |= dict.fromkeys(found.read.told)
    claims = {
        liquid: _claimed(
            claim, [one for one in analyses if one.liquid == liquid], _words(main), settings
        )
        for liquid in dict.fromkeys(one.liquid for one in analyses)
    }
    findings = pd.concat(
        [_findings(one, claims[one.liquid], settings) for one in analyses], ignore_index=True
    )
    tables = {
        "analyses": _analyses_table(analyses, findings),
        "choices": _choices_table(analyses, findings, claims),
        "findings": findings,
        "chance": pd.concat(chances, ignore_index=True),
    }
    answers = [
        _answer(claims[str(liquid)], rows, tables)
        for liquid, rows in findings.groupby("liquid", sort=False)
    ]
    return Multiverse(
        found.read.simulated, tuple(answers), tuple(remarks),
        {name: table for name, table in tables.items() if len(table)},
    )  # fmt: skip


# Exclusions -------------------------------------------------------------------------


def usual_rules(read: StudyTrials) -> list[str]:
    """Rules of exclusion that others would have thought of.

    Parameters
    ----------
    read
        The responses, without any excluded.

    Returns
    -------
    list of str
        Answers that hardly vary, fewer than half of the trials, failed attention checks, very slow
        answers, and second answers to the same scene.
    """
    most = max(int(np.isfinite(one.responses).sum(axis=1).max()) for one in read.trials)
    return ["min-sd=0.05", f"min-trials={most // 2}", "min-attention=0.75", "max-rt=60",
            "repeats=first"]  # fmt: skip


_Rules = tuple[str, ...]


def _words(rules: Sequence[str]) -> str:
    return " + ".join(rules) or NO_RULE


def _rule_sets(study: Path, options: ComparisonOptions) -> tuple[list[_Rules], _Rules, list[str]]:
    """Sets of rules that differ in what they take out, that of the main analysis among them.

    Then what is to be said of the rules.
    """
    if len(options.exclude) > MOST_RULES:
        raise InputError(
            f"exclude: {len(options.exclude)} rules, expected at most {MOST_RULES}: each is tried "
            "with and without all others"
        )
    rules, said = list(options.exclude), []
    if not rules:
        everybody = study_trials(study, replace(options, exclude=()))
        rules = [rule for rule in usual_rules(everybody) if _takes_out(study, options, rule)]
        said = [
            f"tried are the usual exclusions that take somebody out ({', '.join(rules) or 'none'});"
            " --exclude names others"
        ]
    sets: dict[bytes, _Rules] = {}
    for size in range(len(rules) + 1):
        for chosen in combinations(rules, size):
            left = study_trials(study, replace(options, exclude=chosen))
            sets.setdefault(_digest(left), chosen)
    tried = {rule for chosen in sets.values() for rule in chosen}
    said += [f"{rule} takes nothing out that others don't" for rule in rules if rule not in tried]
    return list(sets.values()), sets[_digest(study_trials(study, options))], said


def _takes_out(study: Path, options: ComparisonOptions, rule: str) -> bool:
    """Whether a usual rule fits the table, and takes out something but not everything."""
    try:
        left = study_trials(study, replace(options, exclude=(rule,)))
    except InputError:
        return False
    return any(one.trials for one in left.exclusions)


def _digest(read: StudyTrials) -> bytes:
    """What tells answers from others."""
    return b"".join(
        repr((one.liquid, one.participants, [scene.id for scene in one.scenes])).encode()
        + one.responses.tobytes()
        for one in read.trials
    )


# Analyses ---------------------------------------------------------------------------


def _by_answers(one: PeopleAndModels, exclusions: str, settings: Settings) -> Iterator[_Analysis]:
    """By people's mean answers: each measure, over each of what a conclusion may hold over."""
    responses, names = one.trials.responses, np.array(one.names, dtype=object)
    people, scenes = one.trials.participant_count, len(one.trials.scenes)
    observed = measured(mean_judgments(responses), one.judgments)
    for by in get_args(PairMeasure):
        values = NEARER[by] * getattr(observed, by)
        for over in get_args(Over):
            if unknowable(over, people, scenes):
                continue
            pairs = compare_pairs(responses, one.judgments, over, by)
            ends = np.stack([NEARER[by] * each for each in pairs.interval(settings.level)])
            table = pd.DataFrame(
                {
                    "model": names[pairs.first],
                    "rival": names[pairs.second],
                    "difference": NEARER[by] * pairs.difference,
                    "low": ends.min(axis=0),
                    "high": ends.max(axis=0),
                    "p": pairs.p,
                    "p_holm": holm(pairs.p),
                }
            )
            best = "" if np.isnan(values).all() else str(names[np.nanargmax(values)])
            yield _Analysis(one.trials.liquid, exclusions, people, scenes, by, over, best, table)


def _by_likelihood(
    one: PeopleAndModels, exclusions: str, settings: Settings, report: Report
) -> Iterator[_Analysis]:
    """By the likelihood of single answers, over each unit that is left out."""
    # JAX is loaded only for this.
    from pourcast.statistics.loo import compare_models  # noqa: PLC0415

    found = compare_models(
        one.trials.responses, one.models, Sampling(seed=settings.seed), report,
        level=settings.level,
    )  # fmt: skip
    for unit, rows in found.loo.groupby("unit", sort=False) if len(found.loo) else ():
        pairs, (people, scenes) = (
            found.differences[found.differences["unit"] == unit], one.trials.responses.shape
        )  # fmt: skip
        yield _Analysis(
            one.trials.liquid, exclusions, people, scenes, LIKELIHOOD, str(unit),
            str(rows["model"].iloc[0]), pairs.assign(low=np.nan, high=np.nan),
        )  # fmt: skip


def _unknown(one: PeopleAndModels, exclusions: str) -> Iterator[str]:
    """Which analyses there are none of, and why."""
    people, scenes = one.trials.participant_count, len(one.trials.scenes)
    for over in get_args(Over):
        if why := unknowable(over, people, scenes):
            yield f"{one.trials.liquid}, excluded: {exclusions}: no analysis over {over}: {why}"


def _against_each_truth(one: PeopleAndModels, exclusions: str, settings: Settings) -> pd.DataFrame:
    """Participants against chance, with each ground truth of the liquid that was compared."""
    own = dict.fromkeys((one.truth_name, f"truth-{called(one.trials.liquid)}", stimulus.NAME))
    tables = []
    for truth in own:
        if truth in one.models:
            table = agreement.individuals([replace(one, truth_name=truth)], settings).summary()
            if len(table):
                table.insert(1, "exclusions", exclusions)
                table.insert(2, "truth", truth)
                tables.append(table)
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


# Findings ---------------------------------------------------------------------------


def _claimed(claim: str, analyses: Sequence[_Analysis], main: str, settings: Settings) -> str:
    """The model that is claimed to be nearest, for the trials of one liquid."""
    names = dict.fromkeys(
        str(name) for one in analyses for name in (*one.pairs["model"], *one.pairs["rival"])
    )
    if not names:
        raise InputError("model: expected at least two, to be compared with one another")
    if claim:
        if claim not in names:
            raise InputError(f"claim: {unknown(claim, list(names))}")
        return claim
    own = [one for one in analyses if (one.exclusions, one.measure) == (main, "r") and one.best]
    exact = [one for one in own if one.over == settings.over]
    return (exact or own or list(analyses))[0].best


def _findings(one: _Analysis, claim: str, settings: Settings) -> pd.DataFrame:
    """The claimed model beside each other one."""
    pairs = one.pairs
    first, second = pairs["model"] == claim, pairs["rival"] == claim
    sign = np.where(first, 1.0, -1.0)
    ends = np.stack([sign * pairs["low"], sign * pairs["high"]])
    table = pd.DataFrame(
        {
            "liquid": one.liquid,
            "claim": claim,
            "exclusions": one.exclusions,
            "participants": one.participants,
            "scenes": one.scenes,
            "measure": one.measure,
            "over": one.over,
            "rival": np.where(first, pairs["rival"], pairs["model"]),
            "difference": sign * pairs["difference"],
            "low": ends.min(axis=0),
            "high": ends.max(axis=0),
            "p": pairs["p"],
            "p_holm": pairs["p_holm"],
        }
    )[first | second]
    told = table["p_holm"] < 1.0 - settings.level
    nearer, farther = table["difference"] >= 0.0, table["difference"] < 0.0
    cases = [nearer & told, nearer, farther & ~told, farther]
    return table.assign(finding=np.select(cases, FINDINGS[:4], FINDINGS[4]))


_OWN = ["liquid", "exclusions", "measure", "over"]
"""Columns that tell analyses from one another."""


def _analyses_table(analyses: Sequence[_Analysis], findings: pd.DataFrame) -> pd.DataFrame:
    table = pd.DataFrame([one._asdict() for one in analyses]).drop(columns="pairs")
    counts = findings.groupby(_OWN, sort=False)["finding"]
    found = pd.DataFrame(
        {
            "told_nearer": counts.apply(lambda each: int((each == FINDINGS[0]).sum())),
            "told_farther": counts.apply(lambda each: int((each == FINDINGS[3]).sum())),
            "rivals": counts.size(),
        }
    )
    return table.merge(found.reset_index(), on=_OWN, how="left")


def _choices_table(
    analyses: Sequence[_Analysis], findings: pd.DataFrame, claims: Mapping[str, str]
) -> pd.DataFrame:
    """What each option of each choice finds, the others taken together."""
    table = _analyses_table(analyses, findings)
    table["nearest"] = table["best"] == table["liquid"].map(claims)
    table["told_from"] = table["told_nearer"] / table["rivals"]
    parts = []
    for choice in _OWN[1:]:
        grouped = table.groupby(["liquid", choice], sort=False)
        part = grouped.agg(
            analyses=("nearest", "size"), nearest=("nearest", "mean"),
            told_from=("told_from", "mean"),
        )  # fmt: skip
        part = part.reset_index().rename(columns={choice: "option"})
        part.insert(1, "choice", choice)
        parts.append(part)
    order = list(table["liquid"].unique())
    together = pd.concat(parts, ignore_index=True)
    return together.sort_values("liquid", kind="stable", key=lambda names: names.map(order.index))


# The answer -------------------------------------------------------------------------

_NAMED = 5
"""Models that are named, of more the number."""


def _answer(claim: str, findings: pd.DataFrame, tables: Mapping[str, pd.DataFrame]) -> str:
    """Whether the conclusion stands for a liquid, in three sentences."""
    liquid = findings["liquid"].iloc[0]
    analyses = tables["analyses"]
    own = analyses[analyses["liquid"] == liquid]
    others = own["best"][own["best"] != claim].value_counts()
    else_ = f" (else {', '.join(others.index)})" if len(others) else ""
    first = (
        f"{called(liquid)}: {claim} is nearest to people in {len(own) - others.sum()} of "
        f"{len(own)} analyses{else_}."
    )
    told = (findings["finding"] == FINDINGS[0]).groupby(findings["rival"], sort=False)
    counts, shares = told.sum(), told.mean()
    always, never = list(shares.index[shares == 1.0]), list(shares.index[shares == 0.0])
    partly = [
        f"{name} ({counts[name]})"
        for name in shares.sort_values().index
        if 0.0 < shares[name] < 1.0
    ]
    parts = [
        f"from {_listed(names)} in {how}"
        for names, how in ((always, "all of them"), (partly, "some"), (never, "none"))
        if names
    ]
    second = f"It is told {'; '.join(parts)}."
    lost = findings[findings["finding"] == FINDINGS[3]]
    third = (
        "In none is another model told to be nearer."
        if lost.empty
        else f"In {len(lost.drop_duplicates(_OWN))} another model is told to be nearer: "
        f"{_listed(list(dict.fromkeys(lost['rival'])))}."
    )
    return f"{first} {second} {third}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
