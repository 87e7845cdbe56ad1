"""The policy of one agent as a module of torch. Only :meth:`Run.torch_policy` needs this file, and torch."""

from __future__ import annotations

from typing import Optional

import torch
from torch import nn

from .policy import Weights


class TorchPolicy(nn.Module):  # type: ignore[misc]
    """``policy(obs)`` returns logits ``[batch, actions]`` and values ``[batch]``.

    A policy with a GRU is called ``policy(obs, states)`` and also returns the next states. ``states`` are ``[batch,
    memory]``, zeros when an episode begins; ``memory`` is their width, or 0 without a GRU. The policies of a
    :class:`Run` refuse NaN; a module of torch computes with it.
    """

    def __init__(self, state_dict: Weights) -> None:
        super().__init__()
        own = {name: weights for name, weights in state_dict.items() if not name.startswith("critic.")}
        critics = {name[len("critic.") :]: state_dict[name] for name in state_dict if name not in own}
        self.gru, self.layers = _tower(own)
        self.critic = nn.ModuleDict()
        if critics:
            gru, layers = _tower(critics)
            self.critic = nn.ModuleDict({"layers": layers} if gru is None else {"gru": gru, "layers": layers})
        self.memory = sum(weights.shape[1] for name, weights in state_dict.items() if name.endswith("weight_hh"))
        self.load_state_dict({name: torch.tensor(weights.copy()) for name, weights in state_dict.items()})

    def forward(self, obs: torch.Tensor, states: Optional[torch.Tensor] = None) -> "tuple[torch.Tensor, ...]":
        if self.gru is None:
            outputs = _through(self.layers, obs)
            if self.critic:
                outputs = torch.cat([outputs, _through(self.critic["layers"], obs)], dim=-1)
            return outputs[:, :-1], outputs[:, -1]
        assert states is not None, "a policy with a GRU remembers"
        own = self.gru(obs, states[:, : self.gru.hidden_size])
        outputs, after = _through(self.layers, own), own
        if self.critic:
            critics = self.critic["gru"](obs, states[:, self.gru.hidden_size :])
            outputs = torch.cat([outputs, _through(self.critic["layers"], critics)], dim=-1)
            after = torch.cat([own, critics], dim=-1)
        return outputs[:, :-1], outputs[:, -1], after


def _tower(weights: Weights) -> "tuple[Optional[nn.GRUCell], nn.ModuleList]":
    """Return modules of the shapes of these weights."""
    layers = [value.shape for name, value in weights.items() if name.startswith("layers.") and name.endswith("weight")]
    gru = weights.get("gru.weight_ih")
    cell = None if gru is None else nn.GRUCell(gru.shape[1], gru.shape[0] // 3)
    return cell, nn.ModuleList(nn.Linear(inputs, outputs) for outputs, inputs in layers)


def _through(layers: nn.ModuleList, hidden: torch.Tensor) -> torch.Tensor:
    for number, layer in enumerate(layers):
        hidden = layer(torch.relu(hidden) if number > 0 else hidden)
    return hidden
