"""An influence predictor of one's own: a logistic regression per source, fitted with numpy, that drives local simulators.

    pip install ./python
    python3 examples/own_predictor.py configs/town.toml

What enters a region depends on what stands at its edge. `dials_traffic.datasets` plays episodes on the global simulator and
returns both, as arrays. The predictor learns the first from the second. Its loss on episodes that it has not seen stands
beside that of constants. Then it drives local simulators of all agents.

It knows sources of two classes: whether a vehicle enters or not.
"""

import argparse

import numpy as np

import dials_traffic

STEPS = 300
LEARNING_RATE = 0.5
PENALTY = 3e-3


def entropy(p, sources):
    """Return the mean cross-entropy of each source, in nats."""
    p = np.clip(p, 1e-6, 1 - 1e-6)
    return -np.where(sources == 1, np.log(p), np.log1p(-p)).mean(axis=0)


def flat(dataset):
    return dataset.d_set.reshape(-1, dataset.d_set.shape[-1]), dataset.sources.reshape(-1, dataset.sources.shape[-1])


class Logistic:
    """One regression per agent and source, from the d-set to the probability that the source happens."""

    def fit(self, datasets):
        self.weights, self.biases = [], []
        for dataset in datasets:
            if (dataset.classes != 2).any():
                raise SystemExit(f"{dataset.agent}: has sources of more than two classes")
            inputs, sources = flat(dataset)
            rates = np.clip(sources.mean(axis=0), 1e-4, 1 - 1e-4)
            weights, biases = np.zeros((inputs.shape[1], sources.shape[1])), np.log(rates / (1 - rates))
            for _ in range(STEPS):
                # The gradient of the mean cross-entropy with a penalty on the weights.
                error = 1 / (1 + np.exp(-(inputs @ weights + biases))) - sources
                weights -= LEARNING_RATE * (inputs.T @ error / len(inputs) + PENALTY * weights)
                biases -= LEARNING_RATE * error.mean(axis=0)
            self.weights.append(weights)
            self.biases.append(biases)
        self.weights, self.biases = np.array(self.weights), np.array(self.biases)

    def probabilities(self, agents, d_set):
        """Return ``[rows, sources]``."""
        logits = np.einsum("ri,ris->rs", d_set, self.weights[agents]) + self.biases[agents]
        return 1 / (1 + np.exp(-logits))

    def loss(self, number, dataset):
        inputs, sources = flat(dataset)
        p = 1 / (1 + np.exp(-(inputs @ self.weights[number] + self.biases[number])))
        return entropy(p, sources)[: dataset.own_sources].mean()

    def begin(self, agents, rows):
        self.agents = agents

    def sample(self, d_set, uniform):
        return (uniform < self.probabilities(self.agents, d_set)).astype(np.uint8)


def losses(config, settings=None, episodes=6, seen=4):
    """Return the predictor, its mean loss on new episodes, and that of the best constants of the old ones."""
    datasets = dials_traffic.datasets(config, episodes, settings=settings)
    halves = [
        [
            dials_traffic.Dataset(part.agent, part.d_set[chosen], part.sources[chosen], part.classes, part.own_sources)
            for part in datasets
        ]
        for chosen in (slice(seen), slice(seen, None))
    ]
    predictor = Logistic()
    predictor.fit(halves[0])
    own, constant = [], []
    for number, (old, new) in enumerate(zip(*halves)):
        if new.own_sources > 0:
            own.append(predictor.loss(number, new))
            rates = flat(old)[1].mean(axis=0)
            constant.append(entropy(rates, flat(new)[1])[: new.own_sources].mean())
    return predictor, float(np.mean(own)), float(np.mean(constant))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config")
    args = parser.parse_args()
    predictor, own, constant = losses(args.config)
    print(f"cross-entropy of a source on new episodes: {own:.4f}, of constants {constant:.4f}")
    env = dials_traffic.vector_env(args.config, None, 2, predictor, seed=1)
    obs, infos = env.reset()
    total = 0.0
    for _ in range(env.horizon):
        obs, rewards, _, _, infos = env.step(infos["action_mask"].argmax(axis=1))
        total += rewards.mean()
    print(f"return of the first allowed action in local simulators, with this predictor: {total:.2f}")
    env.close()


if __name__ == "__main__":
    main()
