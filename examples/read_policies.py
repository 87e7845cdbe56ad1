"""Read the policies of a run in Python, with only numpy and safetensors.

    python3 examples/read_policies.py runs/traffic_4-dials-seed1/policies.safetensors
"""

import sys

import numpy as np
from safetensors.numpy import load_file


def judge(policies, obs, state=None):
    """Return the networks' outputs: (logits [agents, batch, actions], values [agents, batch], next state).

    obs: [agents, batch, obs_dim]. state: [agents, batch, hidden], zeros at the beginning of an episode; None for
    policies without a GRU.
    """
    hidden = obs
    if "gru.input_weight" in policies:
        from_obs = np.split(obs @ policies["gru.input_weight"] + policies["gru.input_bias"], 3, axis=-1)
        from_state = np.split(state @ policies["gru.state_weight"] + policies["gru.state_bias"], 3, axis=-1)
        r, z = (1 / (1 + np.exp(-(from_obs[gate] + from_state[gate]))) for gate in (0, 1))
        n = np.tanh(from_obs[2] + r * from_state[2])
        hidden = state = (1 - z) * n + z * state
    layers = sum(name.startswith("layers.") for name in policies) // 2
    for layer in range(layers):
        hidden = hidden @ policies[f"layers.{layer}.weight"] + policies[f"layers.{layer}.bias"]
        hidden = np.maximum(hidden, 0) if layer + 1 < layers else hidden
    return hidden[..., :-1], hidden[..., -1], state


if __name__ == "__main__":
    policies = load_file(sys.argv[1])
    agents, obs_dim, _ = policies.get("gru.input_weight", policies["layers.0.weight"]).shape
    memory = np.zeros((agents, 1, policies["gru.state_weight"].shape[1])) if "gru.state_weight" in policies else None
    logits, values, _ = judge(policies, np.zeros((agents, 1, obs_dim)), memory)
    probabilities = np.exp(logits) / np.exp(logits).sum(axis=-1, keepdims=True)
    for agent in range(agents):
        print(f"agent {agent}: shown nothing, it acts with probabilities {probabilities[agent, 0].round(3)}")
