"""MAPPO in one file, in the manner of CleanRL: one actor for all agents, and a critic that sees all of them.

    pip install ./python torch
    python3 examples/mappo.py configs/town.toml --out runs/mappo

It trains inside `dials_traffic.dials`: simulators, evaluations, checkpoints and files are those of `dials-traffic train`, so
`dials-traffic report` compares the run with others, and `--resume` goes on with it. The critic needs all agents of a
copy at once, so it learns on copies of the global simulator.

On the town, our one run of 21 600 steps (seed 1, four copies) began with a mean return of -15.06 and ended with -2.52, over 10
evaluation episodes. `max-pressure` has -2.33 there (5 episodes), so it is close and not level.

The actor gets the observation of its agent and the agent's number, one-hot. The critic gets the observations of all agents
and returns a value for each. Source: Yu et al. 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games".
"""

import argparse

import numpy as np
import torch
from torch import nn

import dials_traffic

MINIBATCHES = 4
EPOCHS = 4
LEARNING_RATE = 1e-3
GAMMA = 0.98
GAE_LAMBDA = 0.95
CLIP = 0.2
ENTROPY = 0.005
MAX_GRADIENT = 0.5


def network(inputs, outputs, width, last_gain):
    layers = [nn.Linear(inputs, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(), nn.Linear(width, outputs)]
    for layer, gain in zip(layers[::2], (2**0.5, 2**0.5, last_gain)):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers)


class Mappo:
    metrics = ("policy_loss", "value_loss", "entropy")
    update_every_steps = 120

    def __init__(self, team):
        if not team.on_gs:
            raise SystemExit("the critic sees all agents: set simulator = \"gs\"")
        torch.manual_seed(team.seed)
        torch.set_num_threads(1)
        self.team, self.count = team, len(team.agents)
        self.actor = network(team.obs_dim + self.count, team.n_actions, 64, 0.01)
        self.critic = network(team.obs_dim * self.count, self.count, 128, 1.0)
        self.optimiser = torch.optim.Adam([*self.actor.parameters(), *self.critic.parameters()], LEARNING_RATE, eps=1e-5)
        # Mean, square and weight of the returns so far: the critic predicts them in units of their deviation.
        self.returns = np.zeros(3)

    def policy(self, obs, agents, masks):
        """Return log-probabilities, [..., n_actions]."""
        own = nn.functional.one_hot(agents, self.count).float()
        logits = self.actor(torch.cat([obs, own], -1)).masked_fill(~masks, -1e9)
        return torch.log_softmax(logits, -1)

    @torch.no_grad()
    def act(self, rows, explore):
        # As PPO of the program: drawn in training and in evaluations.
        agents = torch.as_tensor(rows.agents.astype(np.int64))
        log_probs = self.policy(torch.as_tensor(rows.obs), agents, torch.as_tensor(rows.masks))
        reached = log_probs.exp().cumsum(-1) > torch.as_tensor(rows.uniform)[:, None]
        last = torch.as_tensor(rows.masks).float().cumsum(-1).argmax(-1)  # the last one that is allowed
        return torch.where(reached.any(-1), reached.float().argmax(-1), last).numpy()

    def learn(self, experience):
        steps, copies = len(experience.obs), self.team.copies

        def by_copy(table):
            """[steps, agents x copies, ...] -> [steps, copies, agents, ...]"""
            shape = (steps, self.count, copies, *table.shape[2:])
            return torch.as_tensor(table.reshape(shape).swapaxes(1, 2).copy())

        obs, masks, actions = by_copy(experience.obs), by_copy(experience.masks), by_copy(experience.actions)
        rewards, ends = by_copy(experience.rewards), by_copy(experience.ends).float()
        next_obs, agents = by_copy(experience.next_obs), torch.arange(self.count).expand(steps, copies, self.count)
        mean, deviation = self.unit()
        with torch.no_grad():
            values = self.critic(obs.flatten(2)) * deviation + mean
            # After the end of an episode the traffic would go on: its value counts, too.
            after = self.critic(next_obs.flatten(2)) * deviation + mean
            old = self.policy(obs, agents, masks).gather(-1, actions[..., None])[..., 0]
        advantages, last = torch.zeros_like(rewards), torch.zeros(copies, self.count)
        for step in reversed(range(steps)):
            last = rewards[step] + GAMMA * after[step] - values[step] + GAMMA * GAE_LAMBDA * (1 - ends[step]) * last
            advantages[step] = last
        returns = advantages + values
        self.note(returns)
        mean, deviation = self.unit()
        targets = (returns - mean) / deviation
        # A sample is a decision of all agents of a copy.
        batch = [part.flatten(0, 1) for part in (obs, agents, masks, actions, old, advantages, targets)]
        sums, updates = np.zeros(3), 0
        for _ in range(EPOCHS):
            for chosen in np.array_split(experience.rng.permutation(steps * copies), MINIBATCHES):
                sums += self.update(*(part[torch.as_tensor(chosen)] for part in batch))
                updates += 1
        return dict(zip(self.metrics, sums / updates))

    def update(self, obs, agents, masks, actions, old, advantages, targets):
        log_probs = self.policy(obs, agents, masks)
        ratio = (log_probs.gather(-1, actions[..., None])[..., 0] - old).exp()
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        gain = torch.min(ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages).mean()
        entropy = -(log_probs.exp() * log_probs.clamp(min=-100)).sum(-1).mean()
        error = (self.critic(obs.flatten(1)) - targets).square().mean()
        self.optimiser.zero_grad()
        (error - gain - ENTROPY * entropy).backward()
        for part in (self.actor, self.critic):
            nn.utils.clip_grad_norm_(part.parameters(), MAX_GRADIENT)
        self.optimiser.step()
        return np.array([-gain.item(), error.item(), entropy.item()])

    def note(self, returns):
        """Add returns to what is known of them. What is old counts less and less."""
        self.returns *= 0.99
        self.returns += [returns.mean().item(), returns.square().mean().item(), 1.0]

    def unit(self):
        mean, square, weight = self.returns
        if weight == 0:
            return 0.0, 1.0
        mean, square = mean / weight, square / weight
        return mean, max(square - mean**2, 1e-8) ** 0.5

    def state(self, saved=None):
        parts = {"actor": self.actor, "critic": self.critic}
        if saved is None:
            state = {f"{name}.{key}": value.numpy() for name, part in parts.items() for key, value in part.state_dict().items()}
            for number, moments in self.optimiser.state_dict()["state"].items():
                state.update({f"adam.{number}.{key}": np.asarray(value) for key, value in moments.items()})
            return {**state, "returns": self.returns}
        self.returns = saved.pop("returns")
        for name, part in parts.items():
            part.load_state_dict({key: torch.as_tensor(saved[f"{name}.{key}"]) for key in part.state_dict()})
        moments = {}
        for name, value in saved.items():
            if name.startswith("adam."):
                _, number, key = name.split(".")
                moments.setdefault(int(number), {})[key] = torch.as_tensor(value)
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": moments})
        return None


def train(config, out, steps, *, copies=4, seed=1, resume=False, settings=None, quiet=False):
    sets = {"simulator": "gs", "gs.copies": copies, "total_steps": steps, "seed": seed, **(settings or {})}
    return dials_traffic.dials(config, learner=Mappo, out=out, settings=sets, resume=resume, quiet=quiet)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config")
    parser.add_argument("--out", required=True, help="run directory")
    parser.add_argument("--steps", type=int, default=21_600, help="timesteps per agent")
    parser.add_argument("--copies", type=int, default=4, help="copies of the global simulator; a divisor of 120")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    args = parser.parse_args()
    run = train(args.config, args.out, args.steps, copies=args.copies, seed=args.seed, resume=args.resume)
    returns = run.table("returns")
    of_all = returns["agent"] == "all"
    print("mean returns:", dict(zip(returns["steps"][of_all].astype(int).tolist(), returns["mean"][of_all].tolist())))


if __name__ == "__main__":
    main()
