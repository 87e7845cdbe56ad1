"""Read the policies of a run in Python, with only numpy and safetensors.

    python3 examples/read_policies.py runs/traffic_4-dials-seed1/policies.safetensors
"""

import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file


#: Largest absolute weight that the program takes, too.
LARGEST_WEIGHT = 1e6


def read(path):
    """Return the tensors of a file of policies, by name. Weights that say nothing are an error."""
    policies = load_file(path)
    for name, weights in policies.items():
        if not np.all(np.abs(weights) <= LARGEST_WEIGHT):
            raise SystemExit(f"{path}: `{name}` holds a weight that is no finite number up to {LARGEST_WEIGHT:g}")
    return policies


def network(policies, obs, state=None, prefix=""):
    """Return the outputs of the networks whose tensors begin with `prefix`, and their next state."""
    hidden = obs
    if prefix + "gru.input_weight" in policies:
        gru = {name: policies[f"{prefix}gru.{name}"] for name in ("input_weight", "input_bias", "state_weight", "state_bias")}
        if state is None:
            state = np.zeros((*obs.shape[:2], gru["state_weight"].shape[1]), obs.dtype)
        from_obs = np.split(obs @ gru["input_weight"] + gru["input_bias"], 3, axis=-1)
        from_state = np.split(state @ gru["state_weight"] + gru["state_bias"], 3, axis=-1)
        r, z = (1 / (1 + np.exp(-(from_obs[gate] + from_state[gate]))) for gate in (0, 1))
        n = np.tanh(from_obs[2] + r * from_state[2])
        hidden = state = (1 - z) * n + z * state
    layers = sum(name.startswith(prefix + "layers.") for name in policies) // 2
    for layer in range(layers):
        hidden = hidden @ policies[f"{prefix}layers.{layer}.weight"] + policies[f"{prefix}layers.{layer}.bias"]
        hidden = np.maximum(hidden, 0) if layer + 1 < layers else hidden
    return hidden, state


def judge(policies, obs, state=None):
    """Return what the policies say: (logits [agents, batch, actions], values [agents, batch], next state).

    obs: [agents, batch, obs_dim]. state: [agents, batch, hidden]; None at the beginning of an episode, and always for
    policies without a GRU. A critic with a network of its own has a state of its own, which follows the policy's.
    """
    if "critic.layers.0.weight" not in policies:
        outputs, state = network(policies, obs, state)
        return outputs[..., :-1], outputs[..., -1], state
    actor_state, critic_state = (None, None) if state is None else np.split(state, 2, axis=-1)
    logits, actor_state = network(policies, obs, actor_state)
    values, critic_state = network(policies, obs, critic_state, "critic.")
    state = None if actor_state is None else np.concatenate([actor_state, critic_state], axis=-1)
    return logits, values[..., 0], state


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_file():
        sys.exit(__doc__)
    policies = read(sys.argv[1])
    agents, obs_dim, _ = policies.get("gru.input_weight", policies["layers.0.weight"]).shape
    logits, values, _ = judge(policies, np.zeros((agents, 1, obs_dim)))
    probabilities = np.exp(logits) / np.exp(logits).sum(axis=-1, keepdims=True)
    for agent in range(agents):
        print(f"agent {agent}: shown nothing, it acts with probabilities {probabilities[agent, 0].round(3)}")
