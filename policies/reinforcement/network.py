"""A trained network as plain arrays, run by numpy."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from policies.consistency import check

Array = NDArray[np.float64]

HIDDEN: dict[str, Callable[[Array], Array]] = {"relu": lambda x: np.maximum(x, 0.0), "tanh": np.tanh}
OUTPUT: dict[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "clip": lambda x: np.clip(x, -1.0, 1.0),
    "linear": lambda x: x,
}


class Network(NamedTuple):
    """A multilayer perceptron y = out(W_L h(... h(W_1 (x - mean) / scale + b_1) ...) + b_L)."""

    weights: tuple[Array, ...]
    """Per layer (out, in)."""
    biases: tuple[Array, ...]
    """Per layer (out,)."""
    mean: Array
    """(in,) subtracted from the input."""
    scale: Array
    """(in,) that it is divided by."""
    hidden: str
    """Activation between layers, a key of `HIDDEN`."""
    output: str
    """Activation of the last layer, a key of `OUTPUT`."""

    @classmethod
    def of(cls, layers: Any, hidden: str, output: str, mean: Array | None = None, scale: Array | None = None) -> Self:
        """From torch's linear layers, in their order."""
        weights = tuple(layer.weight.detach().cpu().numpy().astype(np.float64) for layer in layers)
        biases = tuple(layer.bias.detach().cpu().numpy().astype(np.float64) for layer in layers)
        n = weights[0].shape[1]
        return cls(
            weights, biases, np.zeros(n) if mean is None else mean, np.ones(n) if scale is None else scale,
            hidden, output,
        )  # fmt: skip

    def __call__(self, x: NDArray[Any]) -> Array:
        """The output (out,) for an input (in,), or (n, out) for (n, in)."""
        y = (np.asarray(x, dtype=np.float64) - self.mean) / self.scale
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            y = HIDDEN[self.hidden](y @ weight.T + bias)
        result: Array = OUTPUT[self.output](y @ self.weights[-1].T + self.biases[-1])
        return result

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """JSON values and arrays; `from_arrays` is the inverse."""
        arrays: dict[str, NDArray[Any]] = {"network_mean": self.mean, "network_scale": self.scale}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"network_weight{i}": weight, f"network_bias{i}": bias}
        return {"layers": len(self.weights), "hidden": self.hidden, "output": self.output}, arrays

    @classmethod
    def from_arrays(cls, values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The network that `to_arrays` described; KeyError for an unknown activation or a missing layer."""
        HIDDEN[values["hidden"]], OUTPUT[values["output"]]
        weights, biases = (
            tuple(arrays[f"network_{name}{i}"] for i in range(values["layers"])) for name in ("weight", "bias")
        )
        return cls(weights, biases, arrays["network_mean"], arrays["network_scale"], values["hidden"], values["output"])


def check_network(network: Network, n_inputs: int, n_outputs: int) -> None:
    """Raise ValueError unless a network of finite numbers leads from so many inputs to so many outputs."""
    size = n_inputs
    for name in ("mean", "scale"):
        check(getattr(network, name).shape == (n_inputs,), f"network_{name}")
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        check(weight.ndim == 2 and weight.shape[1] == size and bias.shape == weight.shape[:1], f"network_weight{i}")
        size = weight.shape[0]
    check(size == n_outputs, "network")
    arrays = (network.mean, network.scale, *network.weights, *network.biases)
    check(all(np.isfinite(array).all() for array in arrays) and bool((network.scale > 0.0).all()), "network")
