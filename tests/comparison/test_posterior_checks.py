"""What is told of response models that don't fit, or that priors decide."""

import pandas as pd

from pourcast.comparison.posterior_checks import sensitive_to_priors, unlike_people


def test_statistics_that_are_off_are_named_with_their_models():
    checks = pd.DataFrame(
        {
            "liquid": ["water"] * 6 + ["honey"] * 2, "model": [*"aabbcc", *"ab"],
            "statistic": ["curvature", "SD of answers"] * 4,
            "p": [0.002, 0.5, 0.004, 0.002, 0.006, 0.011, 0.3, 0.02],
        }
    )  # fmt: skip
    [told] = unlike_people(checks)
    assert told.startswith("water: ")
    assert "in curvature (all models), SD of answers (b): " in told
    assert list(unlike_people(checks[checks["liquid"] == "honey"])) == []


def test_parameters_that_priors_decide_are_named_with_their_models():
    posterior = pd.DataFrame(
        {
            "liquid": "water", "model": [*"aabb"], "parameter": ["lapse", "slope"] * 2,
            "diagnosis": ["prior and data may differ", "", "prior says more than data", ""],
        }
    )  # fmt: skip
    [told] = sensitive_to_priors(posterior)
    assert "of lapse (all models): " in told
    assert list(sensitive_to_priors(posterior.assign(diagnosis=""))) == []
