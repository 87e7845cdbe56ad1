"""MAPPO in one file, in the manner of CleanRL: an actor for each agent, and a critic that sees all of them.

    pip install ./python torch
    python3 examples/mappo.py configs/town.toml --out runs/mappo

It trains inside `dials_traffic.dials`: simulators, evaluations, checkpoints and files are those of `dials-traffic train`, so
`dials-traffic report` compares the run with others, and `--resume` goes on with it. The critic needs all agents of a
copy at once, so it learns on copies of the global simulator.

On the town, max-pressure has a mean return of -2.33 +- 0.07. One run of 21 600 steps (seed 1, four copies) began with -15.26,
had -2.30 after 3 600 steps and -1.89 after 7 200, and ended with -1.54 (10 evaluation episodes). Settings follow
docs/ppo.md. Of two critics, the better one with seed 101 was taken.

Lights differ: an action of one is another green than that of the next, and busy lights have ten times the reward of quiet ones.
So each agent has an actor, a spread of its returns and normalised advantages of its own. With one actor, and with all returns
and advantages together, 21 600 steps came to -2.52. The critic gets the agent's observation and a summary of all
observations. Source: Yu et al. 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games".
"""

import argparse

import numpy as np
import torch
from torch import nn

import dials_traffic

MINIBATCHES = 4
EPOCHS = 8
LEARNING_RATE = 1e-3  # falls to 0
GAMMA = 0.98
GAE_LAMBDA = 0.95
CLIP = 0.2
ENTROPY = 0.01
SUMMARY = 64  # width of what the critic makes of all observations
NEWEST = 0.1  # weight of the newest returns in their mean and spread


class Networks(nn.Module):
    """A network of two hidden layers for each agent, computed together: [agents, rows, inputs] -> [agents, rows, outputs]."""

    def __init__(self, count, inputs, outputs):
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for size, width in ((inputs, 64), (64, 64), (64, outputs)):
            self.weights.append(nn.Parameter(torch.empty(count, size, width).uniform_(-(size**-0.5), size**-0.5)))
            self.biases.append(nn.Parameter(torch.zeros(count, 1, width)))

    def forward(self, x):
        for number, (weights, biases) in enumerate(zip(self.weights, self.biases)):
            x = torch.baddbmm(biases, x if number == 0 else torch.relu(x), weights)
        return x


class Mappo:
    metrics = ("policy_loss", "value_loss", "entropy")
    update_every_steps = 120

    def __init__(self, team):
        if not team.on_gs:
            raise SystemExit("the critic sees all agents: set simulator = \"gs\"")
        torch.manual_seed(team.seed)
        torch.set_num_threads(1)
        self.team, self.count = team, len(team.agents)
        self.actor = Networks(self.count, team.obs_dim, team.n_actions)
        self.summary = nn.Sequential(nn.Linear(team.obs_dim * self.count, SUMMARY), nn.Tanh())
        self.critic = Networks(self.count, team.obs_dim + SUMMARY, 1)
        self.parts = {"actor": self.actor, "summary": self.summary, "critic": self.critic}
        parameters = [parameter for part in self.parts.values() for parameter in part.parameters()]
        self.optimiser = torch.optim.Adam(parameters, LEARNING_RATE)
        # Mean, mean square and weight of each agent's returns so far: the critic predicts returns in units of their spread.
        self.returns = torch.zeros(3, self.count, 1)

    def policy(self, obs, masks):
        """Return log-probabilities, [agents, rows, n_actions]."""
        return torch.log_softmax(self.actor(obs).masked_fill(~masks, -1e9), -1)

    def values(self, obs):
        """Return values in units of the returns' spread, [agents, rows]."""
        summary = self.summary(obs.transpose(0, 1).flatten(1))
        return self.critic(torch.cat([obs, summary.expand(self.count, *summary.shape)], -1))[..., 0]

    @torch.no_grad()
    def act(self, rows, explore):
        # As PPO of the program: drawn in training and in evaluations. Rows are ordered by agent.
        def by_agent(table):
            return torch.as_tensor(table).reshape(self.count, -1, table.shape[-1])

        masks = by_agent(rows.masks)
        reached = self.policy(by_agent(rows.obs), masks).exp().cumsum(-1) > by_agent(rows.uniform[:, None])
        last = masks.float().cumsum(-1).argmax(-1)  # the last one that is allowed
        return torch.where(reached.any(-1), reached.float().argmax(-1), last).flatten().numpy()

    def learn(self, experience):
        steps, copies = len(experience.obs), self.team.copies

        def by_agent(table):
            """[steps, agents x copies, ...] -> [agents, steps, copies, ...]"""
            table = table.reshape(steps, self.count, copies, *table.shape[2:])
            return torch.as_tensor(np.moveaxis(table, 1, 0).copy())

        obs, masks, actions = by_agent(experience.obs), by_agent(experience.masks), by_agent(experience.actions)
        rewards, ends = by_agent(experience.rewards), by_agent(experience.ends).float()
        obs, masks, actions = obs.flatten(1, 2), masks.flatten(1, 2), actions.flatten(1, 2)
        next_obs = by_agent(experience.next_obs).flatten(1, 2)
        with torch.no_grad():
            mean, spread = self.unit()
            values = (self.values(obs) * spread + mean).reshape(rewards.shape)
            # After the end of an episode the traffic would go on: its value counts, too.
            after = (self.values(next_obs) * spread + mean).reshape(rewards.shape)
            old = self.policy(obs, masks).gather(-1, actions[..., None])[..., 0]
            advantages, last = torch.zeros_like(rewards), torch.zeros(self.count, copies)
            for step in reversed(range(steps)):
                error = rewards[:, step] + GAMMA * after[:, step] - values[:, step]
                last = error + GAMMA * GAE_LAMBDA * (1 - ends[:, step]) * last
                advantages[:, step] = last
            returns = (advantages + values).flatten(1)
            self.note(returns)
            mean, spread = self.unit()
            targets = (returns - mean) / spread
        left = 1 - (experience.steps - self.update_every_steps) / self.team.total_steps
        for group in self.optimiser.param_groups:
            group["lr"] = LEARNING_RATE * left
        batch = (obs, masks, actions, old, advantages.flatten(1), targets)
        sums, updates = np.zeros(3), 0
        for _ in range(EPOCHS):
            # A sample is a decision of all agents of a copy.
            for chosen in np.array_split(experience.rng.permutation(steps * copies), MINIBATCHES):
                sums += self.update(*(part[:, torch.as_tensor(chosen)] for part in batch))
                updates += 1
        return dict(zip(self.metrics, sums / updates))

    def update(self, obs, masks, actions, old, advantages, targets):
        log_probs = self.policy(obs, masks)
        ratio = (log_probs.gather(-1, actions[..., None])[..., 0] - old).exp()
        # Each agent has its own: the rewards of a busy light are ten times those of a quiet one.
        spread = advantages.std(1, keepdim=True) + 1e-8
        advantages = (advantages - advantages.mean(1, keepdim=True)) / spread
        gain = torch.min(ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages).mean(1)
        entropy = -(log_probs.exp() * log_probs.clamp(min=-100)).sum(-1).mean(1)
        error = (self.values(obs) - targets).square().mean(1)
        self.optimiser.zero_grad()
        (error - gain - ENTROPY * entropy).sum().backward()
        self.optimiser.step()
        return np.array([-gain.mean().item(), error.mean().item(), entropy.mean().item()])

    def note(self, returns):
        """Add returns, [agents, rows], to what is known of them. What is old counts less and less."""
        newest = [returns.mean(1), returns.square().mean(1), torch.ones(self.count)]
        self.returns = (1 - NEWEST) * self.returns + NEWEST * torch.stack(newest)[..., None]

    def unit(self):
        """Return mean and spread of each agent's returns, [agents, 1]."""
        mean, square, weight = self.returns
        if not weight.any():
            return mean, torch.ones_like(mean)
        mean, square = mean / weight, square / weight
        return mean, (square - mean**2).clamp(min=1e-8).sqrt()

    def state(self, saved=None):
        if saved is None:
            state = {
                f"{name}.{key}": value.numpy() for name, part in self.parts.items() for key, value in part.state_dict().items()
            }
            for number, moments in self.optimiser.state_dict()["state"].items():
                state.update({f"adam.{number}.{key}": np.asarray(value) for key, value in moments.items()})
            return {**state, "returns": self.returns.numpy()}
        self.returns = torch.as_tensor(saved.pop("returns"))
        for name, part in self.parts.items():
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
