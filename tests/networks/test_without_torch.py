"""What can be said of networks where there is no torch."""

import subprocess
import sys

import pytest

from pourcast.errors import InputError
from pourcast.models.registry import complete_presets, make_model
from pourcast.scenes.scene_file import write_scenes
from tests.networks.make import card_of, scenes_of


def test_presets_that_want_a_network_say_so():
    assert {"water-convnet", "honey-convnet"}.isdisjoint(complete_presets())
    for spec in ("water-convnet", "honey-convnet", "convnet"):
        with pytest.raises(InputError, match="weights: expected a trained network, such as"):
            make_model(spec)


def test_without_torch_there_is_one_line(tmp_path):
    # Here the card is enough to name a model; judging is what needs torch.
    (tmp_path / "water.safetensors").write_bytes(b"")
    (tmp_path / "water.json").write_text(card_of().model_dump_json())
    write_scenes(tmp_path / "a.json", scenes_of("exp1", 1))
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "from pourcast.cli import run\n"
        "sys.exit(run(['predict', 'a.json', '-m', 'water-convnet:weights=water.safetensors']))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert "this needs torch; install pourcast's extra: pip install '.[convnet]'" in run.stderr
    assert len(run.stderr.splitlines()) == 1
