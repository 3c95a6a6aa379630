"""Likelihood of single answers: ordered beta regression, crossed effects of people and scenes.

With x the logit of the model's judgment, participant p answers scene s by `ordered_beta` with

    eta = intercept + u_p + w_s + (slope + v_p) x,

where u_p, v_p are normal effects of the participant, and w_s one of the scene: what all
participants see in it and the model does not. Without w_s, answers to one scene would count as
independent (Baayen, Davidson & Bates 2008, Journal of Memory and Language 59).

Needs the extra ``pourcast[bayes]``.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray

from pourcast.statistics.ordered_beta import (
    answering_priors,
    log_density,
    predictor,
    sample_answering,
    sample_coefficient,
    sample_effects,
)

Array = NDArray[np.float64]

PARAMETERS = ("intercept", "slope", "spread_intercept", "spread_slope", "spread_scene",
              "precision", "lapse", "cut_low", "cut_high")  # fmt: skip
"""What is estimated for the population; effects of each participant and scene beside."""


class Answers(NamedTuple):
    """Data of one liquid and model.

    Parameters
    ----------
    answers
        Shape [participant_count, scene_count], 0..1; anything where there is none.
    answered
        Where there are answers.
    x
        Logit of the model's judgments, shape [scene_count].
    line
        Pseudo-inverse of the design of a line in x, shape [2, scene_count].
    """

    answers: Array
    answered: NDArray[np.bool_]
    x: Array
    line: Array

    @staticmethod
    def of(responses: Array, judgments: Array) -> "Answers":
        """Data from responses, NaN where there is no answer, and judgments."""
        answered, x = np.isfinite(responses), predictor(judgments)
        line = np.linalg.pinv(np.stack([np.ones_like(x), x], axis=1))
        return Answers(np.where(answered, responses, 0.5), answered, x, line)


class Information(NamedTuple):
    """What answers say of one effect of each kind, in answers' worth."""

    intercept: Any
    slope: Any
    scene: Any


def information(answered: Any, x: Any) -> Information:
    """What answers say of effects. See `Answers`."""
    people, scenes = answered.shape
    each = answered.sum() / people
    return Information(each, each * (x**2).mean(), answered.sum() / scenes)


def priors() -> dict[str, dist.Distribution]:
    """Priors of what is estimated for the population: independent, weakly informative."""
    return {
        "intercept": dist.Normal(0.0, 1.0),
        "slope": dist.Normal(0.5, 0.5),
        "spread_intercept": dist.HalfNormal(0.5),
        "spread_slope": dist.HalfNormal(0.3),
        "spread_scene": dist.HalfNormal(1.0),
        **answering_priors(),
    }


class Predictor(NamedTuple):
    """What eta is made of; any number of draws on axes before those that are named.

    Parameters
    ----------
    intercept, slope
        Of the population.
    participant_intercept, participant_slope
        Effects of participants, shape [participant_count].
    scene
        Effects of scenes, shape [scene_count]; 0 for none.
    """

    intercept: Any
    slope: Any
    participant_intercept: Any
    participant_slope: Any
    scene: Any

    def eta(self, x: Any) -> Any:
        """Eta of each participant and scene, shape [participant_count, scene_count]."""
        level = self.intercept[..., None] + self.participant_intercept
        slope = self.slope[..., None] + self.participant_slope
        return level[..., None] + slope[..., None] * x + self.scene[..., None, :]


def response_model(answers: Any, answered: Any, x: Any, line: Any) -> None:
    """The model, for NumPyro. See `Answers`."""
    people, scenes = answers.shape
    prior = priors()
    spread_intercept, spread_slope, spread_scene = (
        numpyro.sample(name, prior[name])
        for name in ("spread_intercept", "spread_slope", "spread_scene")
    )
    answering = sample_answering()
    known = information(answered, x)
    everybody = jnp.ones((people, 1)), jnp.full((1, people), 1.0 / people)
    u, level = sample_effects(
        "participant_intercept", spread_intercept, known.intercept, *everybody
    )
    v, steepness = sample_effects("participant_slope", spread_slope, known.slope, *everybody)
    design = jnp.stack([jnp.ones(scenes), x], axis=1)
    w, in_line = sample_effects("scene", spread_scene, known.scene, design, line)
    intercept = sample_coefficient("intercept", prior["intercept"], level[0] + in_line[0])
    slope = sample_coefficient("slope", prior["slope"], steepness[0] + in_line[1])
    density = log_density(answers, Predictor(intercept, slope, u, v, w).eta(x), answering)
    numpyro.factor("answers", jnp.where(answered, density, 0.0).sum())
