"""Deep Q-learning inside DIALS in one file, in the manner of CleanRL: one network for all agents.

    pip install ./python torch
    python3 examples/dqn.py configs/town.toml --out runs/dqn

It trains inside `dials_traffic.dials`, on local simulators with influence predictors. Simulators, predictors, evaluations,
checkpoints and files are those of `dials-traffic train`: `dials-traffic report` compares the run with others.

Double Q-learning with a target network. The network gets the observation of an agent and its number, one-hot. The end of an
episode is no end of the traffic, so the value of the last observation counts.
"""

import argparse

import numpy as np
import torch
from torch import nn

import dials_traffic

REPLAY = 20_000
BATCH = 256
GRADIENT_STEPS = 8
LEARNING_RATE = 1e-3
GAMMA = 0.98
TARGET_EVERY = 20  # calls of `learn`
EPSILON, FINAL_EPSILON, EPSILON_SHARE = 1.0, 0.05, 0.3  # share of the run in which it falls
MAX_GRADIENT = 10.0


class Dqn:
    metrics = ("td_loss", "action_value", "epsilon")
    update_every_steps = 16

    def __init__(self, team):
        torch.manual_seed(team.seed)
        torch.set_num_threads(1)
        self.team, self.count = team, len(team.agents)
        self.network, self.target = self.new_network(), self.new_network()
        self.target.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.Adam(self.network.parameters(), LEARNING_RATE)
        width, n_actions = team.obs_dim, team.n_actions
        # Half precision: observations of traffic are 0, 1 and shares.
        self.replay = {
            "agents": np.zeros(REPLAY, np.int64),
            "obs": np.zeros((REPLAY, width), np.float16),
            "actions": np.zeros(REPLAY, np.int64),
            "rewards": np.zeros(REPLAY, np.float32),
            "next_obs": np.zeros((REPLAY, width), np.float16),
            "next_masks": np.zeros((REPLAY, n_actions), bool),
        }
        self.seen = self.calls = 0
        # Rewards are tiny on some maps: the values are in units of their deviation.
        self.rewards = np.zeros(3)

    def new_network(self):
        inputs = self.team.obs_dim + self.count
        layers = [nn.Linear(inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, self.team.n_actions)]
        return nn.Sequential(*layers)

    def values(self, network, obs, agents, masks):
        own = nn.functional.one_hot(torch.as_tensor(agents), self.count).float()
        values = network(torch.cat([torch.as_tensor(obs).float(), own], -1))
        return values if masks is None else values.masked_fill(~torch.as_tensor(masks), -1e9)

    def epsilon(self, steps):
        done = min(1.0, steps / (EPSILON_SHARE * self.team.total_steps))
        return EPSILON + (FINAL_EPSILON - EPSILON) * done

    @torch.no_grad()
    def act(self, rows, explore):
        actions = self.values(self.network, rows.obs, rows.agents.astype(np.int64), rows.masks).argmax(-1).numpy()
        if not explore:
            return actions
        # One number decides whether an action is random, and which one.
        epsilon = self.epsilon(rows.steps)
        allowed = rows.masks.sum(1)
        which = np.minimum((rows.uniform / epsilon * allowed).astype(np.int64), allowed - 1)
        random = (rows.masks.cumsum(1) > which[:, None]).argmax(1)
        return np.where(rows.uniform < epsilon, random, actions)

    def learn(self, experience):
        steps = len(experience.obs)
        new = {name: getattr(experience, name) for name in self.replay if name != "agents"}
        new = {name: table.reshape(-1, *table.shape[2:]) for name, table in new.items()}
        new["agents"] = np.tile(experience.agents.astype(np.int64), steps)
        places = (self.seen + np.arange(len(new["agents"]))) % REPLAY
        for name, table in new.items():
            self.replay[name][places] = table
        self.seen, self.calls = self.seen + len(places), self.calls + 1
        rewards = experience.rewards.astype(np.float64)
        self.rewards += [rewards.mean(), (rewards**2).mean(), 1]
        if self.seen < 4 * BATCH:
            return None
        sums = np.zeros(2)
        for _ in range(GRADIENT_STEPS):
            chosen = experience.rng.integers(min(self.seen, REPLAY), size=BATCH)
            sums += self.update({name: table[chosen] for name, table in self.replay.items()})
        if self.calls % TARGET_EVERY == 0:
            self.target.load_state_dict(self.network.state_dict())
        loss, value = sums / GRADIENT_STEPS
        return {"td_loss": loss, "action_value": value, "epsilon": self.epsilon(experience.steps)}

    def update(self, batch):
        mean, square, weight = self.rewards
        unit = max(square / weight - (mean / weight) ** 2, 1e-12) ** 0.5
        agents, masks = batch["agents"], batch["next_masks"]
        with torch.no_grad():
            best = self.values(self.network, batch["next_obs"], agents, masks).argmax(-1, keepdim=True)
            after = self.values(self.target, batch["next_obs"], agents, None).gather(-1, best)[:, 0]
            targets = torch.as_tensor(batch["rewards"]) / unit + GAMMA * after
        values = self.values(self.network, batch["obs"], agents, None)
        taken = values.gather(-1, torch.as_tensor(batch["actions"])[:, None])[:, 0]
        loss = nn.functional.smooth_l1_loss(taken, targets)
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), MAX_GRADIENT)
        self.optimiser.step()
        return np.array([loss.item(), taken.mean().item()])

    def state(self, saved=None):
        parts = {"network": self.network, "target": self.target}
        if saved is None:
            state = {f"{name}.{key}": value.numpy() for name, part in parts.items() for key, value in part.state_dict().items()}
            for number, moments in self.optimiser.state_dict()["state"].items():
                state.update({f"adam.{number}.{key}": np.asarray(value) for key, value in moments.items()})
            kept = {f"replay.{name}": table[: self.seen] for name, table in self.replay.items()}
            return {**state, **kept, "counts": np.array([self.seen, self.calls]), "rewards": self.rewards}
        self.seen, self.calls = map(int, saved["counts"])
        self.rewards = saved["rewards"]
        for name, table in self.replay.items():
            table[: self.seen] = saved[f"replay.{name}"]
        for name, part in parts.items():
            part.load_state_dict({key: torch.as_tensor(saved[f"{name}.{key}"]) for key in part.state_dict()})
        moments = {}
        for name, value in saved.items():
            if name.startswith("adam."):
                _, number, key = name.split(".")
                moments.setdefault(int(number), {})[key] = torch.as_tensor(value)
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": moments})
        return None


def train(config, out, steps, *, copies=2, seed=1, resume=False, settings=None, quiet=False):
    sets = {"simulator": "dials", "local_simulators.copies": copies, "total_steps": steps, "seed": seed, **(settings or {})}
    return dials_traffic.dials(config, learner=Dqn, out=out, settings=sets, resume=resume, quiet=quiet)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config")
    parser.add_argument("--out", required=True, help="run directory")
    parser.add_argument("--steps", type=int, default=43_200, help="timesteps per agent")
    parser.add_argument("--copies", type=int, default=2, help="local simulators of each agent; a divisor of 16")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    args = parser.parse_args()
    run = train(args.config, args.out, args.steps, copies=args.copies, seed=args.seed, resume=args.resume)
    returns = run.table("returns")
    of_all = returns["agent"] == "all"
    print("mean returns:", dict(zip(returns["steps"][of_all].astype(int).tolist(), returns["mean"][of_all].tolist())))


if __name__ == "__main__":
    main()
