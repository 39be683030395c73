"""The float network as a torch module."""

from __future__ import annotations

import numpy as np
import torch

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.model.cells import Float, run_cell
from eskin.golden.model.model import network_shapes


class RecurrentClassifier(torch.nn.Module):
    """The float network as a torch module: recurrent cell and dense layer, logits after every step.

    Parameters
    ----------
    config:
        Sizes, cell, reset and gate activation.
    batch:
        Leading dimensions of every parameter, (folds, seeds) say: independent networks that train at once.
    generator:
        Source of the initial weights, uniform within +-1/sqrt(H) as in torch's own cells.
    """

    def __init__(
        self, config: AcceleratorConfig, *, batch: tuple[int, ...] = (), generator: torch.Generator
    ) -> None:
        super().__init__()
        self.config = config
        bound = config.network.hidden**-0.5
        self.weights = torch.nn.ParameterDict(
            {
                name: torch.nn.Parameter((torch.rand(*batch, *shape, generator=generator) * 2 - 1) * bound)
                for name, shape in network_shapes(config, real=True).items()
            }
        )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Logits (..., touches, steps, C) of real features (..., touches, steps, inputs)."""
        return run_cell(Float(self.config), self.config, dict(self.weights), features)[1]

    def arrays(self) -> dict[str, np.ndarray]:
        """Copies of the parameters, float64."""
        return {name: weight.detach().double().numpy().copy() for name, weight in self.weights.items()}
