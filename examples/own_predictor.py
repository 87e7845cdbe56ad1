"""An influence predictor of one's own: a logistic regression per source, fitted with numpy, that drives local simulators.

    pip install ./python
    python3 examples/own_predictor.py configs/town.toml --out runs/own-predictor

What enters a region depends on what stands at its edge. `dials_traffic.datasets` plays episodes on the global simulator and
returns both, as arrays. The predictor learns the first from the second. Its loss on episodes that it has not seen stands
beside that of constants. Then `dials_traffic.train` trains policies in local simulators that it drives. There it learns again
whenever our influence predictors would, and its losses are in `aip_loss.csv` and in `dials-traffic report`.

It knows sources of two classes: whether a vehicle enters or not.
"""

import argparse
from dataclasses import replace

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
                raise ValueError(f"{dataset.agent}: has sources of more than two classes")
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

    def loss(self, dataset):
        """Return the loss of each source that the agent has."""
        inputs, sources = flat(dataset)
        p = 1 / (1 + np.exp(-(inputs @ self.weights[dataset.number] + self.biases[dataset.number])))
        return entropy(p, sources)[: dataset.own_sources]

    def state(self, saved=None):
        if saved is not None:
            self.weights, self.biases = saved["weights"], saved["biases"]
        return {"weights": self.weights, "biases": self.biases}

    def begin(self, agents, rows):
        self.agents = agents

    def sample(self, d_set, uniform):
        return (uniform < self.probabilities(self.agents, d_set)).astype(np.uint8)


def losses(config, settings=None, episodes=6, seen=4):
    """Return the predictor, its mean loss on new episodes, and that of the best constants of the old ones."""
    datasets = dials_traffic.datasets(config, episodes, settings=settings)
    halves = [
        [replace(part, d_set=part.d_set[chosen], sources=part.sources[chosen]) for part in datasets]
        for chosen in (slice(seen), slice(seen, None))
    ]
    predictor = Logistic()
    predictor.fit(halves[0])
    own, constant = [], []
    for old, new in zip(*halves):
        if new.own_sources > 0:
            own.append(predictor.loss(new).mean())
            rates = flat(old)[1].mean(axis=0)
            constant.append(entropy(rates, flat(new)[1])[: new.own_sources].mean())
    return predictor, float(np.mean(own)), float(np.mean(constant))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config")
    parser.add_argument("--out", required=True, help="run directory")
    parser.add_argument("--steps", type=int, default=7_200, help="timesteps per agent")
    parser.add_argument("--workers", type=int, default=None, help="processes; they do not change the results")
    args = parser.parse_args()
    _, own, constant = losses(args.config)
    print(f"cross-entropy of a source on new episodes: {own:.4f}, of constants {constant:.4f}")
    settings = {"total_steps": args.steps, "evaluation.every_steps": args.steps // 2}
    run = dials_traffic.train(args.config, predictor=Logistic(), out=args.out, settings=settings, workers=args.workers)
    print(f"dials-traffic report {run.path}")


if __name__ == "__main__":
    main()
