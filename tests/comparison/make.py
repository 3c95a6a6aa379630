"""Studies whose models are made up, so that their answers are known."""

import itertools
import json

import numpy as np
import pandas as pd

from pourcast.models.registry import make_model
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import judgments_of

COUNTS = (15, 25, 50, 75)
ZETAS = tuple(range(17))


def voronoi_scenes(count, seed=0):
    """Scenes as they are drawn, not filtered."""
    rng, family, found = np.random.default_rng(seed), VoronoiFamily(), []
    while len(found) < count:
        scene = family.draw(rng, f"s{len(found):02d}")
        if scene is not None:
            found.append(scene)
    return found


def smooth(rng, scenes, values):
    """Judgments that change smoothly along a parameter, shape [value_count, scene_count]."""
    start, end, bend = rng.random((3, scenes))
    share = np.linspace(0, 1, len(values))[:, None]
    return np.clip(start + (end - start) * share + (bend - 0.5) * np.sin(np.pi * share), 0, 1)


def judgment_table(scenes, spec, judgments, liquid):
    """Rows of a table of judgments: one model, trials with one liquid."""
    return pd.DataFrame(
        {
            "scene": [scene.id for scene in scenes],
            "digest": [scene.digest for scene in scenes],
            "liquid": liquid,
            "model": spec.partition(":")[0],
            "parameters": json.dumps(make_model(spec).parameters()),
            "seed": 0,
            "judgment": judgments,
        }
    )


def made_up_table(scenes, seed=0, n_noise=0.05):
    """A sweep's table: every family that is fitted, judgments made up."""
    rng, tables = np.random.default_rng(seed), []

    def add(spec, judgments, liquid="water"):
        tables.append(judgment_table(scenes, spec, judgments, liquid))

    for head, base in (
        ("water", smooth(rng, len(scenes), ZETAS)),
        ("honey", smooth(rng, len(scenes), ZETAS)),
    ):
        for n in COUNTS:
            shift = n_noise * rng.standard_normal(len(scenes))
            for zeta in ZETAS:
                judgments = np.clip(base[zeta] + shift, 0, 1)
                add(
                    f"ife:liquid={head},n_particles={n},damping_zeta={zeta},zeta_sigma=4", judgments
                )
                add(
                    f"ife:liquid={head},n_particles={n},damping_zeta={zeta},zeta_sigma=0", judgments
                )
    for alpha in (0.2, 2):
        other = smooth(rng, len(scenes), ZETAS)
        for zeta in ZETAS:
            add(
                f"ife:liquid=water,viscosity_alpha={alpha},damping_zeta={zeta},zeta_sigma=4",
                other[zeta],
            )
    marble = smooth(rng, len(scenes), ZETAS)
    for n, zeta in itertools.product((25, 75), ZETAS):
        add(
            f"marble:n_particles={n},damping_zeta={zeta},zeta_sigma=4",
            np.clip(marble[zeta] + 0.001 * n, 0, 1),
        )
    simple = smooth(rng, len(scenes), range(11))
    for k, g in itertools.product(range(11), (0.0, 0.5)):
        add(f"simple:g={g},m={0.02 * k:.2f}", np.clip(simple[k] * (1 - g) + g * 0.5, 0, 1))
    return pd.concat(tables, ignore_index=True)


def people_like(scenes, judgments, people=20, noise=0.1, seed=0, liquid="water"):
    """Trials of people who answer as a model does, with noise."""
    rng = np.random.default_rng(seed)
    answers = np.clip(judgments + noise * rng.standard_normal((people, len(scenes))), 0, 1)
    return Trials(liquid, tuple(f"p{k}" for k in range(people)), tuple(scenes), answers)


def made_up(count=30, seed=0):
    """Scenes, and all judgments of the made-up sweep."""
    scenes = voronoi_scenes(count)
    return scenes, judgments_of([made_up_table(scenes, seed)], scenes)
