"""What a policy is shown, checked before anything changes: the errors name the agent, the column and the value."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

#: Largest absolute value in an observation. Ours are below ten thousand. Far larger ones make a network's sums infinite.
LARGEST_OBSERVATION = 1e6


def observation(agent: str, obs: Any, width: int, columns: Sequence[str] = ()) -> np.ndarray:
    """Return an observation as float32. ``columns``: the names of its first columns; the others are padding."""
    table = _numbers(f"observations: of agent {agent!r}", obs, width)
    wrong = np.flatnonzero(~(np.abs(table) <= LARGEST_OBSERVATION))
    if wrong.size > 0:
        column = int(wrong[0])
        raise ValueError(
            f"observations: of agent {agent!r}: {_named('column', column, columns)} is {table[column]}; must be a finite "
            f"number from {-LARGEST_OBSERVATION:g} to {LARGEST_OBSERVATION:g}"
        )
    return table.astype(np.float32)


def action_mask(agent: str, mask: Any, n_actions: int, actions: Sequence[str] = ()) -> np.ndarray:
    """Return a mask as bools. ``actions``: the names of the first actions."""
    table = _numbers(f"action masks: of agent {agent!r}", mask, n_actions)
    wrong = np.flatnonzero((table != 0) & (table != 1))
    if wrong.size > 0:
        action = int(wrong[0])
        raise ValueError(
            f"action masks: of agent {agent!r}: {_named('action', action, actions)} has {table[action]}; must be 1, "
            "allowed, or 0"
        )
    allowed: np.ndarray = table == 1
    if not allowed.any():
        raise ValueError(f"action masks: of agent {agent!r}: all {n_actions} are 0; at least one action must be allowed")
    return allowed


def _numbers(what: str, shown: Any, width: int) -> np.ndarray:
    """Return one row of numbers. Nobody decides for a batch: policies with a memory see one observation at a time."""
    try:
        table = np.asarray(shown)
    except ValueError:
        # Lists of different lengths.
        raise ValueError(f"{what} of no regular shape instead of ({width},)") from None
    if table.shape != (width,):
        raise ValueError(f"{what} of shape {table.shape} instead of ({width},)")
    if table.dtype.kind not in "fiub":
        raise TypeError(f"{what}: must be numbers, not {table.dtype}")
    return table


def _named(kind: str, number: int, names: Sequence[str]) -> str:
    return f"{kind} {number} ({names[number]})" if number < len(names) else f"{kind} {number}"
