"""Half-trained networks, kept after every pass, so that learning goes on where it stopped."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pourcast.files import replacing
from pourcast.networks.backbones import torch_module


def save_checkpoint(path: Path, key: str, content: Mapping[str, Any]) -> None:
    """Keep a state.

    Parameters
    ----------
    path
        The file.
    key
        Name of all that determines the training; a state of another is never gone on with.
    content
        Tensors, numbers and words.
    """
    with replacing(path) as temporary:
        torch_module().save({"key": key, **content}, temporary)


def load_checkpoint(path: Path, key: str) -> dict[str, Any] | None:
    """A state that was kept; None if there is none, or it is damaged or of another training."""
    try:
        content = io.BytesIO(path.read_bytes())
        found = torch_module().load(content, map_location="cpu", weights_only=True)
    except Exception:  # However it is damaged: learning begins anew.
        return None
    return found if isinstance(found, dict) and found.get("key") == key else None
