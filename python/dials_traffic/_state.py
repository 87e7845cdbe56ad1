"""What learners and predictors of the user keep in checkpoints: arrays by name, as bytes."""

from __future__ import annotations

import io
import json
from typing import Any, Dict, Mapping

import numpy as np


def to_bytes(arrays: Mapping[str, Any]) -> np.ndarray:
    """Write arrays by name: their names in a line of JSON, and then each as `numpy.save` does."""
    names = sorted(arrays)
    file = io.BytesIO()
    file.write(json.dumps(names).encode() + b"\n")
    for name in names:
        array = np.asarray(arrays[name])
        if array.dtype.hasobject:
            raise TypeError(f"state: {name!r} is no array of numbers")
        np.save(file, array, allow_pickle=False)
    return np.frombuffer(file.getvalue(), np.uint8)


def from_bytes(data: np.ndarray) -> Dict[str, np.ndarray]:
    """Read what :func:`to_bytes` wrote."""
    file = io.BytesIO(data.tobytes())
    names = json.loads(file.readline())
    return {name: np.load(file, allow_pickle=False) for name in names}
