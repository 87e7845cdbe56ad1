"""PPO for all agents of a config in one file, on the global simulator. In the manner of CleanRL.

    pip install ./python torch
    python3 examples/ppo.py configs/smoke_traffic.toml

Our one run of 120 000 steps ended with a mean return of 191. Random actions have 144.

All agents share one network, and each row of a batch is one agent of one copy. `dials_traffic.vector_parallel_env`
steps the copies together, each in a process of its own. Actions that are not allowed have probability 0.
"""

import argparse
import time

import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import dials_traffic

ROLLOUT_STEPS = 64
MINIBATCHES = 8
EPOCHS = 4
LEARNING_RATE = 1e-3
GAMMA = 0.99
GAE_LAMBDA = 0.95
CLIP = 0.2
ENTROPY = 0.01
VALUE = 0.5
MAX_GRADIENT = 0.5


class Agent(nn.Module):
    """Actor and critic: observations [rows, obs_dim] -> a distribution over actions, and values [rows]."""

    def __init__(self, obs_dim, n_actions):
        super().__init__()
        self.actor = self.network(obs_dim, n_actions, last_gain=0.01)
        self.critic = self.network(obs_dim, 1, last_gain=1.0)

    @staticmethod
    def network(inputs, outputs, last_gain):
        layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
        for layer, gain in zip(layers[::2], (2**0.5, 2**0.5, last_gain)):
            nn.init.orthogonal_(layer.weight, gain)
            nn.init.zeros_(layer.bias)
        return nn.Sequential(*layers)

    def policy(self, obs, masks):
        return Categorical(logits=self.actor(obs).masked_fill(~masks, -1e9))

    def value(self, obs):
        return self.critic(obs)[:, 0]


class Rows:
    """The copies of an environment as one table, `[agents x copies]` rows."""

    def __init__(self, config, copies, seed):
        self.env = dials_traffic.vector_parallel_env(config, copies, seed=seed)
        self.agents, self.copies = self.env.agents, copies
        spaces = {(self.env.observation_space(agent).shape, self.env.action_space(agent).n) for agent in self.agents}
        if len(spaces) > 1:
            raise SystemExit(f"{config}: its agents have {len(spaces)} shapes, and one network fits one shape")
        ((self.obs_dim,), self.n_actions), = spaces

    def stacked(self, tables):
        return torch.as_tensor(np.concatenate([tables[agent] for agent in self.agents]))

    def reset(self):
        obs, infos = self.env.reset()
        return self.stacked(obs), self.stacked(infos["action_mask"]).bool()

    def step(self, actions):
        """Return what is shown, rewards, ends, observations before the ends, and the mean return at an end."""
        by_agent = dict(zip(self.agents, actions.numpy().reshape(len(self.agents), self.copies)))
        obs, rewards, _, ends, infos = self.env.step(by_agent)
        final = self.stacked(infos["final_obs"]) if "final_obs" in infos else None
        masks = self.stacked(infos["action_mask"]).bool()
        return self.stacked(obs), masks, self.stacked(rewards).float(), self.stacked(ends).float(), final


def advantages_of(rewards, values, after, ends):
    """Return generalised advantage estimates, [steps, rows]. `after`: values of what came after each step."""
    advantages, last = torch.zeros_like(rewards), 0.0
    for step in reversed(range(len(rewards))):
        delta = rewards[step] + GAMMA * after[step] - values[step]
        last = delta + GAMMA * GAE_LAMBDA * (1 - ends[step]) * last
        advantages[step] = last
    return advantages


def update(agent, optimiser, batch):
    """Improve the networks on a rollout, a dict of tables whose first dimension is the sample."""
    count = len(batch["obs"])
    for _ in range(EPOCHS):
        for chosen in torch.randperm(count).tensor_split(MINIBATCHES):
            obs, masks, actions, old, advantages, returns = (part[chosen] for part in batch.values())
            policy = agent.policy(obs, masks)
            ratio = (policy.log_prob(actions) - old).exp()
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
            gain = torch.min(ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages).mean()
            error = (agent.value(obs) - returns).square().mean()
            loss = -gain + VALUE * error - ENTROPY * policy.entropy().mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRADIENT)
            optimiser.step()


def train(config, steps, copies, seed):
    """Train on `copies` of a config for `steps` per agent. Return the networks, and the mean return of each episode."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    rows = Rows(config, copies, seed)
    agent = Agent(rows.obs_dim, rows.n_actions)
    optimiser = torch.optim.Adam(agent.parameters(), LEARNING_RATE, eps=1e-5)

    (obs, masks), begun = rows.reset(), time.monotonic()
    so_far, finished = torch.zeros(len(obs)), []
    updates = max(1, steps // (ROLLOUT_STEPS * copies))
    for number in range(1, updates + 1):
        rollout = {name: [] for name in ("obs", "masks", "actions", "log_probs", "rewards", "values", "after", "ends")}
        with torch.no_grad():
            for _ in range(ROLLOUT_STEPS):
                policy = agent.policy(obs, masks)
                actions = policy.sample()
                seen = (obs, masks, actions, policy.log_prob(actions), agent.value(obs))
                obs, masks, rewards, ends, final = rows.step(actions)
                # The horizon only cuts the recording: the value of what would come stands for the rest.
                after = agent.value(obs if final is None else final)
                for name, part in zip(("obs", "masks", "actions", "log_probs", "values"), seen):
                    rollout[name].append(part)
                for name, part in (("rewards", rewards), ("after", after), ("ends", ends)):
                    rollout[name].append(part)
                so_far += rewards
                if final is not None:
                    finished.append(so_far.mean().item())
                    so_far.zero_()
        tables = {name: torch.stack(parts) for name, parts in rollout.items()}
        advantages = advantages_of(tables["rewards"], tables["values"], tables["after"], tables["ends"])
        batch = {name: tables[name] for name in ("obs", "masks", "actions", "log_probs")}
        batch.update(advantages=advantages, returns=advantages + tables["values"])
        update(agent, optimiser, {name: part.flatten(0, 1) for name, part in batch.items()})
        if finished and (number % 10 == 0 or number == updates):
            done, seconds = number * ROLLOUT_STEPS * copies, time.monotonic() - begun
            print(f"step {done}: mean return {finished[-1]:.2f}, {done / seconds:.0f} steps per second", flush=True)
    rows.env.close()
    return agent, finished


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config")
    parser.add_argument("--steps", type=int, default=120_000, help="per agent, in all copies together")
    parser.add_argument("--envs", type=int, default=4, help="copies of the environment, each a process")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args(words)
    return train(arguments.config, arguments.steps, arguments.envs, arguments.seed)[1]


if __name__ == "__main__":
    main()
