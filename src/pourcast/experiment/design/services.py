"""What has to be set at the services that send participants, or that collect their answers."""

from collections.abc import Iterator

from pourcast.experiment.design.links import PROLIFIC
from pourcast.experiment.design.settings import NAME, RecruitingDesign

_QUERY = "&".join(f"{name}={{{{%{name}%}}}}" for name in PROLIFIC)

_ENDS = {
    "complete": "who completes",
    "screened_out": "whose screen is too small",
    "failed_check": "who fails the questions",
}


def prolific_settings(recruiting: RecruitingDesign, link: str) -> Iterator[str]:
    """Yield what to set on Prolific, a line each.

    Parameters
    ----------
    recruiting
        Completion codes, and the way back.
    link
        The page's, without Prolific's parameters.
    """
    yield f"Prolific: study link {link}{'&' if '?' in link else '?'}{_QUERY}"
    yield "Prolific: record ids with URL parameters, under these names"
    for end, who in _ENDS.items():
        code = recruiting.codes[end]
        if code:
            yield f"Prolific: completion path with the code {code}, for {who}"
        elif end == "complete":
            yield f"Prolific: no code for {who}: each gets a code of their own [{NAME}: recruiting]"
        else:
            yield f"Prolific: no code for {who} [{NAME}: recruiting]"
    if not recruiting.redirect:
        yield f"Prolific: no way back from the last page, only the code [{NAME}: recruiting]"


def datapipe_settings(experiment: str) -> Iterator[str]:
    """Yield what to set on DataPipe for the experiment of an id, a line each."""
    yield f'DataPipe: https://pipe.jspsych.org/admin/{experiment} > "Enable data collection": on'
    yield "DataPipe: validation as it is (JSON allowed, required field trial_type), or off"
    yield "DataPipe: no session limit, or one above the number of people that you expect"
    yield "DataPipe: take part once yourself; a file that ends in .json must be where you collect"


def jatos_settings() -> Iterator[str]:
    """Yield what to set on JATOS, a line each."""
    yield "JATOS: Prolific's parameters go behind the study link; they are saved with the results"
    yield f'JATOS: "End Redirect URL" is not used, the way back is in {NAME}: recruiting'
    yield "JATOS: take part once yourself; export the results, and take them in with --import"
