"""What the experiments of pourcast 0.1 have in common, so that older studies can be repeated."""

from collections.abc import Mapping
from typing import Any

from pourcast.simulation.settings import EngineSettings
from pourcast.study.selection import CoarseFilter

SETTINGS = EngineSettings(
    step=4e-4,
    sound_speed=30.0,
    support_in_spacings=2.3,
    courant=0.4,
    frame_rate=30.0,
    max_duration=10.0,
    contact_radius=0.5,
    contact_layer=0.1,
    viscous_pairs="approaching",
    marble_radius=0.5,
    damping_scale=1.0,
    dimensions=3,
)
"""How 0.1 computed."""

FILTER = CoarseFilter(
    n_particles=50,
    damping_zeta=5.0,
    max_stranded=0.05,
    min_touched=0.9,
    liquid="water-v0",
    settings=SETTINGS,
)
"""The filter of Experiment 1, and of practice in both."""


def presets_with(honey: str) -> tuple[str, ...]:
    """The paper's models with the liquids of 0.1 in the head."""
    return (
        "water-ife:liquid=water-v0",
        f"honey-ife-1:liquid={honey}",
        "honey-ife-2:liquid=water-v0",
        "truth-water:liquid=water-v0",
        f"truth-honey:liquid={honey}",
        "water-marble",
        "honey-marble",
        "water-simple",
        "honey-simple",
        "gravity",
        "position-uncertainty",
    )


def words_of(honey: str) -> Mapping[str, Any]:
    """What participants read of the liquids."""
    return {
        "liquids": {
            "water-v0": {"name": "water", "description": "The blue liquid is water."},
            honey: {
                "name": "honey",
                "description": "The yellow liquid is honey: thick, sticky and slow.",
            },
        }
    }
