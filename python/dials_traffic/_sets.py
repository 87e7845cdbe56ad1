"""Networks over the lanes and greens of a light, in numpy. docs/any-light.md says what they compute."""

from __future__ import annotations

from typing import Dict, Mapping

import numpy as np

#: Where a lane shows its queue and how long it has been red: the logarithm of a second more than that, over 5.
QUEUE, RED = 4, 13
#: Where a green shows the same for people who wait to walk.
RED_ON_FOOT = 10
#: Weight of the sum over all items.
_OF_ALL = np.float32(0.25)


class OverSets:
    """A network whose inputs are items and choices, however many there are."""

    def __init__(self, weights: Dict[str, np.ndarray], sets: Mapping[str, int]) -> None:
        """``sets``: numbers of features, and of ways in which items belong to choices."""
        self._weights = weights
        self._item, self._choice, self._ways = sets["item_features"], sets["choice_features"], sets["ways"]

    def items(self, columns: int, choices: int) -> int:
        """Return for how many items an observation of so many columns has room. 0: it is of something else."""
        left, width = columns - choices * self._choice, self._item + choices * self._ways
        return 0 if choices < 1 or left < 0 or left % width else left // width

    def for_the_overdue(self, obs: np.ndarray, allowed: np.ndarray, longest_red_s: int) -> np.ndarray:
        """Return which choices are allowed if cars and people shall not stand at red for longer."""
        choices = allowed.size
        count = self.items(obs.size, choices)
        lanes, rest = np.split(obs, [count * self._item])
        marks, belongs = np.split(rest, [choices * self._choice])
        lanes, belongs = lanes.reshape(count, self._item), belongs.reshape(choices, self._ways, count)
        red, on_foot = np.where(lanes[:, QUEUE] > 0, lanes[:, RED], 0), marks.reshape(choices, self._choice)[:, RED_ON_FOOT]
        longest = max(red.max(), on_foot.max())
        serving: np.ndarray = allowed & ((belongs[:, 0, red == longest] > 0).any(axis=1) | (on_foot == longest))
        return serving if np.rint(np.expm1(5 * longest)) >= longest_red_s and serving.any() else allowed

    def outputs(self, obs: np.ndarray, choices: int) -> np.ndarray:
        """Return a score for each choice, 0 for those that are not there, and the value."""
        count = self.items(obs.size, choices)
        items, rest = np.split(obs, [count * self._item])
        marks, belongs = np.split(rest, [choices * self._choice])
        items, marks = items.reshape(count, self._item), marks.reshape(choices, self._choice)
        # What is not there has a zero first.
        here = items[:, 0] != 0
        belongs = belongs.reshape(choices, self._ways, count)[:, :, here]
        hidden, layer = items[here], 0
        while f"items.{layer}.weight" in self._weights:
            hidden = np.maximum(self._affine(f"items.{layer}", hidden), 0)
            layer += 1
        seen = np.concatenate([marks, (belongs @ hidden).reshape(choices, -1)], axis=1)
        total = _OF_ALL * hidden.sum(axis=0)
        scores = self._head("choices", np.concatenate([seen, np.tile(total, (choices, 1))], axis=1))
        value = self._head("value", np.concatenate([marks[:, 1] @ seen, total])[None])
        return np.concatenate([np.where(marks[:, 0] != 0, scores, 0), value])

    def _affine(self, name: str, rows: np.ndarray) -> np.ndarray:
        result: np.ndarray = rows @ self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"]
        return result

    def _head(self, name: str, rows: np.ndarray) -> np.ndarray:
        return self._affine(f"{name}.1", np.maximum(self._affine(f"{name}.0", rows), 0))[:, 0]
