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

from pourcast.comparison import agreement, posterior_checks, stimulus
from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import is_fitted, not_fitted
from pourcast.comparison.matching import (
    ComparisonOptions,
    Matched,
    StudyTrials,
    match_trials,
    study_trials,
)
from pourcast.errors import InputError, unknown
from pourcast.extras import require_extra
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import agreement as measured
from pourcast.statistics.correlation import mean_judgments
from pourcast.statistics.differences import NEARER, PairMeasure, compare_pairs, holm
from pourcast.statistics.jackknife import Over, unknowable
from pourcast.statistics.sampling import Sampling
from pourcast.study.trials import Trials

NO_RULE = "nobody"
"""What is excluded where no rule is."""

_AND = " + "
"""Between rules that are applied together."""

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
    model that is nearest), `nearest` (whether that is the claimed one), and how many others are of
    each finding. `choices`: for each option of a choice the share of analyses in which the claimed
    model is `nearest`, and the mean share of the others from which it is told (`told_from`).
    """

    simulated: bool
    answers: tuple[str, ...]
    remarks: tuple[str, ...]
    tables: dict[str, pd.DataFrame]


class _Analysis(NamedTuple):
    """One way to analyse the trials of one liquid.

    `nearness`: how near each model is to people, the larger the nearer; NaN where that is unknown.
    `pairs`: `model`, `rival`, `difference` (positive where the model is nearer), `low`, `high`, `p`
    and `p_holm`.
    """

    liquid: str
    exclusions: str
    participants: int
    scenes: int
    measure: str
    over: str
    nearness: Mapping[str, float]
    pairs: pd.DataFrame

    @property
    def best(self) -> str:
        """The nearest model; empty if that is unknown."""
        known = {name: value for name, value in self.nearness.items() if not np.isnan(value)}
        return max(known, key=known.__getitem__) if known else ""

    def is_nearest(self, name: str) -> bool:
        """Whether no other model is nearer than this one."""
        return bool(self.best and self.nearness[name] >= self.nearness[self.best] - _EQUAL)


_EQUAL = 1e-12
"""Models nearer to one another than this are equally near to people."""


def study_multiverse(
    study: Path, options: ComparisonOptions, claim: str = "", report: Report = no_report
) -> Multiverse:
    """Compare a study's models with people in every way that could be defended.

    Exclusions (each rule applied and not applied, with all others) x measure (r, RMSE; with
    `options.bayes` the likelihood of single answers) x what a conclusion holds over. Parameters of
    fitted models are chosen anew for each; by r, so these are not compared by RMSE. Ground truths
    that are compared are among the models.

    Parameters
    ----------
    study
        The study folder.
    options
        What is compared. Its rules of exclusion are those that are tried; without any, the usual
        ones as far as they fit (`usual_rules`). The main analysis excludes by all the rules that
        are given, and measures r over `options.settings.over`.
    claim
        The model that is claimed to be nearest to people; by default, and for liquids without that
        model, the one that is nearest in the main analysis.
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
    made = _analysed(study, options, claim, report)
    analyses = made.analyses
    claims = _claims(claim, analyses, made.main, settings)
    findings = pd.concat(
        [_findings(one, claims[one.liquid], settings) for one in analyses if _has(one, claims)],
        ignore_index=True,
    )
    tables = {
        "analyses": _analyses_table(analyses, findings, claims),
        "findings": findings,
        "chance": pd.concat(made.chances, ignore_index=True) if made.chances else pd.DataFrame(),
    }
    tables["choices"] = _choices_table(tables["analyses"])
    answers = [
        _answer(claims[str(liquid)], rows, tables["analyses"])
        for liquid, rows in findings.groupby("liquid", sort=False)
    ]
    remarks = dict.fromkeys([*made.remarks, *_claims_remarks(claim, claims, analyses)])
    return Multiverse(
        made.simulated, tuple(answers), tuple(remarks),
        {name: tables[name] for name in TABLES if len(tables[name])},
    )  # fmt: skip


class _Made(NamedTuple):
    """All analyses, participants against chance in each, and what is to be said of them.

    `main`: for each liquid, what is excluded in the main analysis.
    """

    simulated: bool
    analyses: list[_Analysis]
    chances: list[pd.DataFrame]
    main: dict[str, str]
    remarks: list[str]


def _analysed(study: Path, options: ComparisonOptions, claim: str, report: Report) -> _Made:
    if options.bayes:
        require_extra("bayes")
    settings, rules = options.settings, _tried_rules(study, options)
    analyses: list[_Analysis] = []
    chances: list[pd.DataFrame] = []
    remarks, seen, main = list(rules.remarks), dict[bytes, str](), dict[str, str]()
    liquids: tuple[str, ...] = ()
    for done, (chosen, read) in enumerate(rules.sets.items()):
        words, is_main = _words(chosen), chosen == rules.main
        report(f"excluded: {words}", done, len(rules.sets))
        try:
            found = match_trials(study, read, options)
        except InputError as error:
            # What is wrong with the study or the models is so without rules, too.
            if not done:
                raise
            remarks.append(_not_analysed(words, error))
            continue
        if not done:
            _check_claim(claim, found.people)
            liquids = tuple(one.trials.liquid for one in found.people)
        # Rules that take out nothing of a liquid's answers make no other analysis of it.
        new = [one for one in found.people if _digest(one.trials) not in seen]
        first = {one.trials.liquid: seen.setdefault(_digest(one.trials), words)
                 for one in found.people}  # fmt: skip
        main |= first if is_main else {}
        for one in new:
            analyses += _by_answers(one, words, settings)
            if options.bayes:
                by_likelihood, said = _by_likelihood(one, words, settings, report)
                analyses += by_likelihood
                remarks += [f"excluded: {words}: {text}" for text in said]
            remarks += _unknown(one, words)
        remarks += _remarks(found, words, liquids, is_main=is_main)
        chances += _against_each_truth(found.people, new, words, settings)
    if not analyses:
        raise InputError(f"{found.read.path}: {'; '.join(remarks)}")
    return _Made(found.read.simulated, analyses, chances, main, remarks)


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


def _words(rules: Sequence[str]) -> str:
    return _AND.join(rules) or NO_RULE


def rules_in(words: str) -> list[str]:
    """The rules that are applied where these words stand under `exclusions`.

    Examples
    --------
    >>> rules_in("min-sd=0.1 + max-rt=30"), rules_in(NO_RULE)
    (['min-sd=0.1', 'max-rt=30'], [])
    """
    return [] if words == NO_RULE else words.split(_AND)


class _Rules(NamedTuple):
    """Sets of rules that differ in what they take out, and what they leave.

    `main`: that of the main analysis, one of them.
    """

    sets: dict[tuple[str, ...], StudyTrials]
    main: tuple[str, ...]
    remarks: list[str]


def _tried_rules(study: Path, options: ComparisonOptions) -> _Rules:
    if len(options.exclude) > MOST_RULES:
        raise InputError(
            f"exclude: {len(options.exclude)} rules, expected at most {MOST_RULES}: each is tried "
            "with and without all others"
        )
    main, said = tuple(dict.fromkeys(options.exclude)), []
    rules = list(main)
    if not rules:
        everybody = study_trials(study, options)
        rules = [rule for rule in usual_rules(everybody) if _takes_out(study, options, rule)]
        said = [
            f"tried are the usual exclusions that take somebody out ({', '.join(rules) or 'none'});"
            " --exclude names others"
        ]
    sets: dict[tuple[str, ...], StudyTrials] = {}
    first: dict[bytes, tuple[str, ...]] = {}
    for chosen in (some for size in range(len(rules) + 1) for some in combinations(rules, size)):
        try:
            left = study_trials(study, replace(options, exclude=chosen))
        except InputError as error:
            if len(chosen) < 2 or chosen == main:
                raise
            said.append(_not_analysed(_words(chosen), error))
            continue
        same = first.setdefault(b"".join(_digest(one) for one in left.trials), chosen)
        sets.setdefault(same, left)
        main = same if chosen == main else main
    tried = {rule for chosen in sets for rule in chosen}
    said += [f"{rule} takes nothing out that others don't" for rule in rules if rule not in tried]
    return _Rules(sets, main, said)


def _not_analysed(words: str, error: InputError) -> str:
    return f"not analysed: excluded: {words} ({error})"


def _takes_out(study: Path, options: ComparisonOptions, rule: str) -> bool:
    """Whether a usual rule fits the table, and takes out something but not everything."""
    try:
        left = study_trials(study, replace(options, exclude=(rule,)))
    except InputError:
        return False
    return any(one.trials for one in left.exclusions)


def _digest(one: Trials) -> bytes:
    """What tells answers to the trials of a liquid from others."""
    which = (one.liquid, one.participants, [scene.id for scene in one.scenes])
    return repr(which).encode() + one.responses.tobytes()


# Analyses ---------------------------------------------------------------------------


def _by_answers(one: PeopleAndModels, exclusions: str, settings: Settings) -> Iterator[_Analysis]:
    """By people's mean answers: each measure, over each of what a conclusion may hold over."""
    responses = one.trials.responses
    people, scenes = one.trials.participant_count, len(one.trials.scenes)
    for by in get_args(PairMeasure):
        names = [name for name in one.names if by == "r" or not is_fitted(name)]
        if not names:
            continue
        judgments = np.stack([one.models[name] for name in names])
        observed = NEARER[by] * getattr(measured(mean_judgments(responses), judgments), by)
        values = dict(zip(names, observed.tolist(), strict=True))
        labels = np.array(names, dtype=object)
        for over in get_args(Over):
            if unknowable(over, people, scenes):
                continue
            pairs = compare_pairs(responses, judgments, over, by)
            ends = np.stack([NEARER[by] * each for each in pairs.interval(settings.level)])
            table = pd.DataFrame(
                {
                    "model": labels[pairs.first],
                    "rival": labels[pairs.second],
                    "difference": NEARER[by] * pairs.difference,
                    "low": ends.min(axis=0),
                    "high": ends.max(axis=0),
                    "p": pairs.p,
                    "p_holm": holm(pairs.p),
                }
            )
            yield _Analysis(one.trials.liquid, exclusions, people, scenes, by, over, values, table)


def _by_likelihood(
    one: PeopleAndModels, exclusions: str, settings: Settings, report: Report
) -> tuple[list[_Analysis], list[str]]:
    """By the likelihood of single answers, over each unit that is left out; what is to be said."""
    # JAX is loaded only for this.
    from pourcast.statistics.loo import compare_models  # noqa: PLC0415

    responses, liquid = one.trials.responses, one.trials.liquid
    found = compare_models(
        responses, one.models, Sampling(seed=settings.seed), report, level=settings.level,
        checked=False,
    )  # fmt: skip
    analyses, (people, scenes) = [], responses.shape
    for unit in dict.fromkeys(found.loo["unit"]) if len(found.loo) else ():
        rows = found.loo[found.loo["unit"] == unit]
        pairs = found.differences[found.differences["unit"] == unit]
        values = dict(zip(rows["model"], rows["elpd"], strict=True))
        analyses.append(
            _Analysis(
                liquid, exclusions, people, scenes, LIKELIHOOD, str(unit), values,
                pairs.assign(low=np.nan, high=np.nan),
            )
        )  # fmt: skip
    posterior = found.parameters.assign(liquid=liquid)
    return analyses, list(posterior_checks.not_converged(posterior, ""))


def _unknown(one: PeopleAndModels, exclusions: str) -> Iterator[str]:
    """Which analyses there are none of, and why."""
    people, scenes = one.trials.participant_count, len(one.trials.scenes)
    for over in get_args(Over):
        if why := unknowable(over, people, scenes):
            yield f"{one.trials.liquid}, excluded: {exclusions}: no analysis over {over}: {why}"


def _remarks(
    found: Matched, exclusions: str, liquids: Sequence[str], *, is_main: bool
) -> Iterator[str]:
    """What `compare` would tell of the answers, and of which liquid rules leave none."""
    yield from found.read.told
    there = {one.trials.liquid for one in found.people}
    for liquid in liquids:
        if liquid not in there:
            yield f"{liquid}: not analysed: excluded: {exclusions} (nobody is left)"
    if is_main:
        yield from found.read.remarks
        names = {one.trials.liquid: one.names for one in found.people}
        yield from not_fitted(found.fitted, names)
        for one in found.people:
            if one.trials.means_of is None and not _truths(one):
                yield (
                    f"{one.trials.liquid}: participants are not set beside chance: no ground truth "
                    "was compared"
                )
        fitted = dict.fromkeys(name for some in names.values() for name in some if is_fitted(name))
        if fitted:
            yield (
                f"{', '.join(fitted)}: not compared by RMSE, as parameters are chosen by r, and "
                "both halves of the scenes have one level and spread"
            )


def _against_each_truth(
    people: Sequence[PeopleAndModels],
    new: Sequence[PeopleAndModels],
    exclusions: str,
    settings: Settings,
) -> Iterator[pd.DataFrame]:
    """Participants against chance, with each ground truth of their liquid that was compared."""
    liquids = {one.trials.liquid for one in new}
    for truth in dict.fromkeys(name for one in new for name in _truths(one)):
        own = [replace(one, truth_name=truth if truth in _truths(one) else "-") for one in people]
        table = agreement.individuals(own, settings).summary()
        if len(table):
            table.insert(1, "exclusions", exclusions)
            table.insert(2, "truth", truth)
            yield table[table["liquid"].isin(liquids)]


def _truths(one: PeopleAndModels) -> list[str]:
    """Ground truths of the liquid that are among the models."""
    own = dict.fromkeys((one.truth_name, f"truth-{called(one.trials.liquid)}", stimulus.NAME))
    return [name for name in own if name in one.models]


# Findings ---------------------------------------------------------------------------


_NOTHING_CLAIMED = "nothing is claimed: no model correlates with what people answered"


def _check_claim(claim: str, people: Sequence[PeopleAndModels]) -> None:
    """Refuse a claim about a model that is compared for no liquid."""
    names = list(dict.fromkeys(name for one in people for name in one.names))
    if claim and claim not in names:
        raise InputError(f"claim: {unknown(claim, names)}")


def _claims(
    claim: str, analyses: Sequence[_Analysis], main: Mapping[str, str], settings: Settings
) -> dict[str, str]:
    """The model that is claimed to be nearest, for the trials of each liquid; empty if none is."""
    claims = {}
    for liquid in dict.fromkeys(one.liquid for one in analyses):
        own = [one for one in analyses if one.liquid == liquid]
        if all(len(one.nearness) < 2 for one in own):
            raise InputError("model: expected at least two, to be compared with one another")
        if any(claim in one.nearness for one in own):
            claims[liquid] = claim
            continue
        by_r = [one for one in own if one.measure == "r" and one.best]
        exact = [one for one in by_r if one.exclusions == main.get(liquid)]
        over = [one for one in exact if one.over == settings.over]
        claims[liquid] = next((one.best for one in (*over, *exact, *by_r)), "")
    if not any(claims.values()):
        raise InputError(f"claim: {_NOTHING_CLAIMED}; name one (--claim MODEL)")
    return claims


def _claims_remarks(
    claim: str, claims: Mapping[str, str], analyses: Sequence[_Analysis]
) -> Iterator[str]:
    """Where what is claimed is another model, or none, or can't be looked for."""
    for liquid, own in claims.items():
        everything = [one for one in analyses if one.liquid == liquid]
        without = [one for one in everything if own not in one.nearness]
        if not own:
            yield f"{liquid}: {_NOTHING_CLAIMED}"
            continue
        if claim and own != claim:
            yield f"{liquid}: there is no {claim}: {own} is claimed in its place"
        if without:
            how = dict.fromkeys(f"{one.measure}, excluded: {one.exclusions}" for one in without)
            yield f"{liquid}: {own} is not in {len(without)} analyses ({'; '.join(how)})"


def _has(one: _Analysis, claims: Mapping[str, str]) -> bool:
    """Whether the claimed model is in an analysis, and others are."""
    return claims[one.liquid] in one.nearness and len(one.nearness) > 1


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
    nearer, farther = table["difference"] >= -_EQUAL, table["difference"] < -_EQUAL
    known = table["p_holm"].notna()
    cases = [nearer & told, nearer & known, farther & ~told & known, farther & told]
    return table.assign(finding=np.select(cases, FINDINGS[:4], FINDINGS[4]))


_OWN = ["liquid", "exclusions", "measure", "over"]
"""Columns that tell analyses from one another."""


def _analyses_table(
    analyses: Sequence[_Analysis], findings: pd.DataFrame, claims: Mapping[str, str]
) -> pd.DataFrame:
    """A row an analysis: what is nearest in it, and what is found of the claimed model."""
    rows = [
        {
            "liquid": one.liquid, "exclusions": one.exclusions, "participants": one.participants,
            "scenes": one.scenes, "measure": one.measure, "over": one.over,
            "claim": claims[one.liquid], "best": one.best,
            "nearest": one.is_nearest(claims[one.liquid]),
        }
        for one in analyses
        if _has(one, claims)
    ]  # fmt: skip
    counts = findings.groupby(_OWN, sort=False)["finding"].value_counts().unstack(fill_value=0)
    counts = counts.reindex(columns=list(FINDINGS), fill_value=0).rename(columns=_as_column)
    return pd.DataFrame(rows).merge(counts.reset_index(), on=_OWN, how="left")


def _as_column(words: str) -> str:
    return words.replace(" ", "_")


def _choices_table(analyses: pd.DataFrame) -> pd.DataFrame:
    """What each option of each choice finds, the others taken together.

    A row a liquid, choice and option: `analyses`; `nearest`, the share in which the claimed model
    is the nearest; `told_from`, the mean share of the others from which it is told to be nearer.
    """
    others = analyses[[_as_column(finding) for finding in FINDINGS]].sum(axis=1)
    table = analyses.assign(
        nearest=analyses["nearest"].astype(float).where(analyses["best"] != ""),
        told_from=analyses["told_nearer"] / others,
    )
    applied = table["exclusions"].map(rules_in)
    options = {"measure": table["measure"], "over": table["over"]} | {
        rule: applied.map(lambda rules, rule=rule: "excluded" if rule in rules else "not")
        for rule in dict.fromkeys(applied.explode().dropna())
    }
    every = pd.concat([table.assign(choice=name, option=of) for name, of in options.items()])
    found = every.groupby(["liquid", "choice", "option"], sort=False).agg(
        analyses=("option", "size"), nearest=("nearest", "mean"), told_from=("told_from", "mean")
    )  # fmt: skip
    found = found.reset_index()
    # A rule that takes nothing out of a liquid's answers is no choice there.
    is_choice = found.groupby(["liquid", "choice"])["option"].transform("size") > 1
    found = found[is_choice | found["choice"].isin(["measure", "over"])]
    order = list(table["liquid"].unique())
    by_liquid = found.sort_values("liquid", kind="stable", key=lambda names: names.map(order.index))
    return by_liquid.reset_index(drop=True)


# The answer -------------------------------------------------------------------------

_NAMED = 5
"""Models that are named, of more the number."""


def _answer(claim: str, findings: pd.DataFrame, analyses: pd.DataFrame) -> str:
    """Whether the conclusion stands for a liquid, in three sentences."""
    own = analyses[analyses["liquid"] == findings["liquid"].iloc[0]]
    # Over what a conclusion holds changes nothing of which model is nearest, but by likelihood.
    by = own["measure"].where(own["measure"] != LIKELIHOOD, own["measure"] + own["over"])
    ways = own.assign(by=by).drop_duplicates(["exclusions", "by"])
    ways = ways[ways["best"] != ""]
    others = list(dict.fromkeys(ways["best"][~ways["nearest"]]))
    instead = f" (elsewhere {_listed(others)})" if others else ""
    first = (
        f"{called(own['liquid'].iloc[0])}: {claim} is nearest to people in "
        f"{ways['nearest'].sum()} of {len(ways)} combinations of exclusions and measure{instead}."
    )
    known = findings[findings["finding"] != FINDINGS[4]]
    told = (known["finding"] == FINDINGS[0]).groupby(known["rival"], sort=False)
    shares, counts, sizes = told.mean(), told.sum(), told.size()
    always, never = list(shares.index[shares == 1.0]), list(shares.index[shares == 0.0])
    partly = [
        f"{name} ({counts[name]} of {sizes[name]})"
        for name in shares.sort_values().index
        if 0.0 < shares[name] < 1.0
    ]
    parts = [
        f"from {_listed(names)} in {how}"
        for names, how in ((always, "all of them"), (partly, "some"), (never, "none"))
        if names
    ]
    unknowns = sorted(set(findings["rival"]) - set(known["rival"]))
    unclear = f" Whether it is told from {_listed(unknowns)} is unknown." if unknowns else ""
    second = f"In {len(own)} analyses it is told {'; '.join(parts)}." if parts else ""
    lost = findings[findings["finding"] == FINDINGS[3]]
    third = (
        "In none is another model told to be nearer."
        if lost.empty
        else f"In {len(lost.drop_duplicates(_OWN))} another model is told to be nearer: "
        f"{_listed(list(dict.fromkeys(lost['rival'])))}."
    )
    return f"{first} {second}{unclear} {third}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
