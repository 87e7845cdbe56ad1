"""Deep Q-learning inside DIALS in one file, in the manner of CleanRL: a network for each agent.

    pip install ./python torch
    python3 examples/dqn.py configs/town.toml --out runs/dqn

It trains inside `dials_traffic.dials`, on local simulators with influence predictors. Simulators, predictors, evaluations,
checkpoints and files are those of `dials-traffic train`: `dials-traffic report` compares the run with others. With
`--simulator gs` it learns on the global simulator instead, without predictors.

Double Q-learning with a target network. Lights differ, so each agent has a network, a replay and a unit of its rewards. The end
of an episode is no end of the traffic, so the value of the last observation counts.

On the town, max-pressure has a mean return of -2.33 +- 0.07. Two runs of 7 200 steps on the global simulator (seeds 1 and 2) began
with -15.12, and ended with -1.415 and -1.384 (10 evaluation episodes). On local simulators the town was not tried.
"""

import argparse

import numpy as np
import torch
from torch import nn

import dials_traffic

REPLAY = 2_000  # decisions of each agent
BATCH = 32  # decisions of each agent
GRADIENT_STEPS = 16
LEARNING_RATE = 1e-3  # falls to 0
GAMMA = 0.98
TARGET_EVERY = 10  # calls of `learn`
EPSILON, FINAL_EPSILON, EPSILON_SHARE = 1.0, 0.02, 0.3  # share of the run in which it falls


class Networks(nn.Module):
    """A network of two hidden layers for each agent, computed together: [agents, rows, inputs] -> [agents, rows, outputs]."""

    def __init__(self, count, inputs, outputs):
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for size, width in ((inputs, 64), (64, 64), (64, outputs)):
            self.weights.append(nn.Parameter(torch.empty(count, size, width).uniform_(-(size**-0.5), size**-0.5)))
            self.biases.append(nn.Parameter(torch.zeros(count, 1, width)))

    def forward(self, x, agents):
        for number, (weights, biases) in enumerate(zip(self.weights, self.biases)):
            x = torch.baddbmm(biases[agents], x if number == 0 else torch.relu(x), weights[agents])
        return x


class Dqn:
    metrics = ("td_loss", "action_value", "epsilon")
    update_every_steps = 16

    def __init__(self, team):
        torch.manual_seed(team.seed)
        torch.set_num_threads(1)
        self.team, self.count = team, len(team.agents)
        self.network, self.target = (Networks(self.count, team.obs_dim, team.n_actions) for _ in range(2))
        self.target.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.Adam(self.network.parameters(), LEARNING_RATE)
        size, width, n_actions = (self.count, REPLAY), team.obs_dim, team.n_actions
        # Half precision: observations of traffic are 0, 1 and shares.
        self.replay = {
            "obs": np.zeros((*size, width), np.float16),
            "actions": np.zeros(size, np.int64),
            "rewards": np.zeros(size, np.float32),
            "next_obs": np.zeros((*size, width), np.float16),
            "next_masks": np.zeros((*size, n_actions), bool),
        }
        # Decisions so far, and calls of `learn`, of each agent.
        self.seen, self.calls = np.zeros(self.count, np.int64), np.zeros(self.count, np.int64)

    def epsilon(self, steps):
        done = min(1.0, steps / (EPSILON_SHARE * self.team.total_steps))
        return EPSILON + (FINAL_EPSILON - EPSILON) * done

    @torch.no_grad()
    def act(self, rows, explore):
        # Rows are ordered by agent, and every agent has as many.
        agents = np.unique(rows.agents).astype(np.int64)
        obs = torch.as_tensor(rows.obs).reshape(len(agents), -1, rows.obs.shape[1])
        values = self.network(obs, agents).flatten(0, 1)
        actions = values.masked_fill(~torch.as_tensor(rows.masks), -1e9).argmax(-1).numpy()
        if not explore and self.seen.any():
            return actions
        # One number decides whether an action is random, and which one. What has learnt nothing yet would show the same green for
        # ever: its traffic jams, and influence predictors would learn from jams.
        epsilon = self.epsilon(rows.steps) if explore else 1.0
        allowed = rows.masks.sum(1)
        which = np.minimum((rows.uniform / epsilon * allowed).astype(np.int64), allowed - 1)
        random = (rows.masks.cumsum(1) > which[:, None]).argmax(1)
        return np.where(rows.uniform < epsilon, random, actions)

    def learn(self, experience):
        agents = np.unique(experience.agents).astype(np.int64)
        steps, first = len(experience.obs), agents[0]
        for name, kept in self.replay.items():
            # [steps, agents x copies, ...] -> [agents, steps x copies, ...]
            table = getattr(experience, name)
            table = np.moveaxis(table.reshape(steps, len(agents), -1, *table.shape[2:]), 1, 0)
            table = table.reshape(len(agents), -1, *table.shape[3:])
            kept[agents[:, None], (self.seen[first] + np.arange(table.shape[1])) % REPLAY] = table
        self.seen[agents] += table.shape[1]
        self.calls[agents] += 1
        full = min(self.seen[first], REPLAY)
        if full < 4 * BATCH:
            return None
        for group in self.optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1 - (experience.steps - self.update_every_steps) / self.team.total_steps)
        # The rewards of a busy light are ten times those of a quiet one: values are in units of their spread.
        unit = self.replay["rewards"][agents, :full].std(axis=1, keepdims=True) + 1e-6
        losses, values = np.zeros(len(agents)), np.zeros(len(agents))
        for _ in range(GRADIENT_STEPS):
            chosen = agents[:, None], experience.rng.integers(full, size=(len(agents), BATCH))
            batch = {name: torch.as_tensor(table[chosen]) for name, table in self.replay.items()}
            loss, value = self.update(agents, batch, torch.as_tensor(unit))
            losses, values = losses + loss / GRADIENT_STEPS, values + value / GRADIENT_STEPS
        if self.calls[first] % TARGET_EVERY == 0:
            self.target.load_state_dict(self.network.state_dict())
        by_row = np.repeat(np.array([losses, values]), self.team.copies, axis=1)
        return {"td_loss": by_row[0], "action_value": by_row[1], "epsilon": self.epsilon(experience.steps)}

    def update(self, agents, batch, unit):
        next_obs = batch["next_obs"].float()
        with torch.no_grad():
            best = self.network(next_obs, agents).masked_fill(~batch["next_masks"], -1e9).argmax(-1, keepdim=True)
            after = self.target(next_obs, agents).gather(-1, best)[..., 0]
            targets = batch["rewards"] / unit + GAMMA * after
        taken = self.network(batch["obs"].float(), agents).gather(-1, batch["actions"][..., None])[..., 0]
        loss = nn.functional.smooth_l1_loss(taken, targets, reduction="none").mean(1)
        self.optimiser.zero_grad()
        loss.sum().backward()
        self.optimiser.step()
        return loss.detach().numpy(), taken.detach().mean(1).numpy()

    def state(self, saved=None):
        parts = {"network": self.network, "target": self.target}
        full = min(self.seen.max(), REPLAY)
        if saved is None:
            state = {f"{name}.{key}": value.numpy() for name, part in parts.items() for key, value in part.state_dict().items()}
            for number, moments in self.optimiser.state_dict()["state"].items():
                state.update({f"adam.{number}.{key}": np.asarray(value) for key, value in moments.items()})
            kept = {f"replay.{name}": table[:, :full] for name, table in self.replay.items()}
            return {**state, **kept, "seen": self.seen, "calls": self.calls}
        self.seen, self.calls = saved["seen"], saved["calls"]
        for name, table in self.replay.items():
            part = saved[f"replay.{name}"]
            table[:, : part.shape[1]] = part
        for name, part in parts.items():
            part.load_state_dict({key: torch.as_tensor(saved[f"{name}.{key}"]) for key in part.state_dict()})
        moments = {}
        for name, value in saved.items():
            if name.startswith("adam."):
                _, number, key = name.split(".")
                moments.setdefault(int(number), {})[key] = torch.as_tensor(value)
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": moments})
        return None


def train(config, out, steps, *, simulator="dials", copies=2, seed=1, resume=False, settings=None, quiet=False):
    sets = {"simulator": simulator, "gs.copies": copies, "local_simulators.copies": copies, "total_steps": steps, "seed": seed}
    # Influence predictors learn again whenever a quarter of the run is over.
    sets = {**sets, "aip.retrain_every_steps": max(16, steps // 4), **(settings or {})}
    return dials_traffic.dials(config, learner=Dqn, out=out, settings=sets, resume=resume, quiet=quiet)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config")
    parser.add_argument("--out", required=True, help="run directory")
    parser.add_argument("--steps", type=int, default=43_200, help="timesteps per agent")
    parser.add_argument("--simulator", choices=["dials", "gs"], default="dials", help="gs: copies of the global simulator")
    parser.add_argument("--copies", type=int, default=2, help="simulators of each agent; a divisor of 16")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    args = parser.parse_args()
    options = {"simulator": args.simulator, "copies": args.copies, "seed": args.seed, "resume": args.resume}
    run = train(args.config, args.out, args.steps, **options)
    returns = run.table("returns")
    of_all = returns["agent"] == "all"
    print("mean returns:", dict(zip(returns["steps"][of_all].astype(int).tolist(), returns["mean"][of_all].tolist())))


if __name__ == "__main__":
    main()
