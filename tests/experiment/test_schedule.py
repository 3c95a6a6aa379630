"""Who sees what, and when: seeded, balanced, and made of the stimuli that are there."""

import pytest

from pourcast.errors import InputError
from pourcast.experiment.design.materials import Materials, prepare_materials
from pourcast.experiment.storage.storage import Storage
from pourcast.study.folder import load_practice, study_scenes
from tests.experiment.make import EXP1, small_study


def materials_of(folder, experiment="exp1", **options):
    study = small_study(folder, experiment, **options)
    storage = Storage.of_study(study)
    materials = prepare_materials(study, storage.secret)
    storage.close()
    return materials


def order(materials, group=0, place=0):
    return [
        (s.scene, s.liquid)
        for s in materials.steps(group, place)
        if s.phase == "test" and s.kind == "judgment"
    ]


def test_one_order_is_shared_by_all_and_by_groups_that_see_one_liquid_each(tmp_path):
    two = 'groups = [["water"], ["honey"]]\npractice = 1\n'
    materials = materials_of(tmp_path, design=two)
    assert order(materials, 0, 0) == order(materials, 0, 7)
    assert [scene for scene, _ in order(materials, 0)] == [
        scene for scene, _ in order(materials, 1)
    ]
    assert order(materials) != [(scene.id, "water") for scene in materials.scenes]
    assert sorted(order(materials)) == [(scene.id, "water") for scene in materials.scenes]


def test_own_orders_differ_by_place_and_come_again_with_the_seed(tmp_path):
    materials = materials_of(tmp_path, design=EXP1 + 'order = "own"\nseed = 4\n')
    assert order(materials, 0, 0) != order(materials, 0, 1)
    assert order(materials, 0, 1) == order(materials, 0, 1)


@pytest.mark.parametrize(
    ("scenes", "blocks", "sizes"),
    [(6, 3, [2, 2, 2]), (7, 3, [2, 3, 2]), (2, 3, [1, 1]), (5, 1, [5])],
)
def test_blocks_are_as_even_as_can_be_with_breaks_between(tmp_path, scenes, blocks, sizes):
    materials = materials_of(tmp_path, scenes=scenes, design=EXP1 + f"blocks = {blocks}\n")
    steps = materials.steps(0, 0)
    counts = [
        sum(s.block == b for s in steps if s.kind == "judgment") for b in range(1, len(sizes) + 1)
    ]
    assert counts == sizes
    assert sum(step.kind == "break" for step in steps) == len(sizes) - 1
    assert steps[-1].kind == "debrief"


def test_too_few_practice_scenes_are_told_of(tmp_path):
    study = small_study(tmp_path, design='groups = [["water"]]\npractice = 3\n')
    with pytest.raises(InputError, match=r"practice.json: expected 3 scenes.* found 1"):
        prepare_materials(study, b"secret")


def test_names_differ_between_studies_and_are_the_same_in_one(tmp_path):
    materials = materials_of(tmp_path)
    design, scenes = materials.design, study_scenes(tmp_path)
    names = []
    for secret in (b"a", b"a", b"b"):
        other = Materials(tmp_path, scenes, load_practice(tmp_path), design, secret)
        other.prepare()
        names.append(set(other.published))
    assert names[0] == names[1]
    assert not names[0] & names[2]
