"""Networks over the lanes and greens of a light, in numpy. docs/any-light.md says what they compute."""

from __future__ import annotations

from typing import Dict, Mapping

import numpy as np

#: Where a lane shows its queue in tens of cars, how long it has been red, the share of the cars that is not seen, and how long its
#: detector at the stop line was occupied.
QUEUE, RED, NOT_SEEN, OCCUPIED = 4, 13, 19, 22
#: Where a green shows that it is shown, for how long, how many people wait to walk, and for how long they could not.
SHOWN, SHOWN_FOR, ON_FOOT, RED_ON_FOOT = 2, 3, 9, 10
#: Queues for which a green stays, and that count their red three times.
SEVERAL, LONG_QUEUE = np.float32(0.3), np.float32(0.8)
#: Weight of the sum over all items.
_OF_ALL = np.float32(0.25)


def seconds(times: np.ndarray) -> np.ndarray:
    """Return the seconds that features show: the logarithm of a second more than that, over 5."""
    result: np.ndarray = np.rint(np.expm1(5 * times))
    return result


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

    def by_the_rules(self, obs: np.ndarray, allowed: np.ndarray, longest_red_s: int, hold_s: int) -> np.ndarray:
        """Return which choices are allowed if a queue shall pass, and cars and people not stand at red for longer.

        A green stays for ``hold_s`` while several cars stand on a lane that it opens, and nobody waits to walk.
        """
        choices = allowed.size
        count = self.items(obs.size, choices)
        lanes, rest = np.split(obs, [count * self._item])
        marks, belongs = np.split(rest, [choices * self._choice])
        lanes, marks = lanes.reshape(count, self._item), marks.reshape(choices, self._choice)
        opens, queue = belongs.reshape(choices, self._ways, count)[:, 0] > 0, lanes[:, QUEUE]
        # Where each seen car stands for several, a queue is no more than a guess.
        sure = np.where(lanes[:, NOT_SEEN] == 0, queue, 0)
        needed = (marks[:, SHOWN] == 1) & (seconds(marks[:, SHOWN_FOR]) < hold_s) & opens[:, sure >= SEVERAL].any(axis=1)
        stays: np.ndarray = allowed & needed
        if stays.any() and not marks[:, ON_FOOT].any():
            return stays
        stands = (queue > 0) | (lanes[:, OCCUPIED] >= 1)
        red = np.where(stands, seconds(lanes[:, RED]) * np.where(sure >= LONG_QUEUE, 3, 1), 0)
        on_foot = seconds(marks[:, RED_ON_FOOT])
        longest = max(red.max(), on_foot.max())
        serving: np.ndarray = allowed & (opens[:, red == longest].any(axis=1) | (on_foot == longest))
        return serving if longest >= longest_red_s and serving.any() else allowed

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
