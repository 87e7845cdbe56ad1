"""Train one intersection with stable-baselines3 on its local simulators, and measure it on the global simulator.

    pip install ./python stable-baselines3
    python3 examples/sb3_local.py configs/smoke_traffic.toml r0c0 --steps 40000

After 40 000 steps its light had a return of 208 and 202 (seeds 1 and 2) on the whole network in one episode, and random
play 117 and 105. The other lights follow gap-out.

The influence of the other lights on this one is a constant that is measured first (`marginals`). With a run directory
instead, `--predictor RUN`, it is what the run's influence predictors say.
"""

import argparse

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

import dials_traffic


class Sb3Env(VecEnv):
    """A vector environment of dials_traffic as stable-baselines3 has them."""

    def __init__(self, env):
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self):
        return self.env.reset()[0]

    def step_async(self, actions):
        self.env.step_async(actions)

    def step_wait(self):
        obs, rewards, _, truncations, infos = self.env.step_wait()
        of_rows = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(truncations):
            of_rows[row] = {"terminal_observation": infos["final_obs"][row], "TimeLimit.truncated": True}
        return obs, rewards.astype(np.float32), truncations, of_rows

    def close(self):
        self.env.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name, value, indices=None):
        setattr(self.env, attr_name, value)

    def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
        raise NotImplementedError("the rows are one process and have no methods of their own")

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * len(list(self._get_indices(indices)))


def play(config, agent, decide, seed, controller_for_others):
    """Return the agent's return in an episode on the global simulator, in which a controller has the other lights."""
    with_all = dials_traffic.parallel_env(config)
    others = {other: controller_for_others for other in with_all.possible_agents if other != agent}
    with_all.close()
    env = dials_traffic.parallel_env(config, seed=seed, controller_for=others)
    observations, _ = env.reset()
    total = 0.0
    while env.agents:
        observations, rewards, _, _, _ = env.step({agent: decide(observations[agent])})
        total += rewards[agent]
    env.close()
    return total


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config")
    parser.add_argument("agent")
    parser.add_argument("--predictor", default="marginals", help="a run directory, marginals or untrained")
    parser.add_argument("--steps", type=int, default=40_000)
    parser.add_argument("--copies", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args(words)

    rows = Sb3Env(
        dials_traffic.vector_env(
            arguments.config, arguments.agent, arguments.copies, arguments.predictor, seed=arguments.seed, stagger=True
        )
    )
    policy = PPO(
        "MlpPolicy",
        rows,
        learning_rate=1e-3,
        n_steps=32,
        batch_size=128,
        gamma=0.95,
        ent_coef=0.005,
        seed=arguments.seed,
        device="cpu",
    )
    policy.learn(arguments.steps)
    rows.close()

    rng = np.random.default_rng(arguments.seed)
    players = {
        "trained": lambda obs: int(policy.predict(obs, deterministic=False)[0]),
        "random": lambda obs: int(rng.integers(rows.action_space.n)),
    }
    for name, decide in players.items():
        total = play(arguments.config, arguments.agent, decide, 0, "gap-out")
        print(f"{name}: return {total:.2f} on the whole network")


if __name__ == "__main__":
    main()
