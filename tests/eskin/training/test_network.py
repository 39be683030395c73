"""The torch module of a float network: what it computes quickly against the cells' own text."""

import torch

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import Float, run_cell
from eskin.training.formats import with_network
from eskin.training.network import RecurrentClassifier
from tests.support.table import each_row


@each_row("networks, hidden, steps", [(3, 5, 7), (1, 4, 1)])
def test_a_gru_by_hand_has_the_logits_and_gradients_of_the_cell(networks, hidden, steps):
    config = with_network(AcceleratorConfig(), cell="gru", hidden=hidden)
    draws = torch.Generator().manual_seed(networks)
    network = RecurrentClassifier(config, batch=(networks,), generator=draws).double()
    features = torch.randn(networks, 6, steps, config.inputs, generator=draws, dtype=torch.float64)
    quick = network(features)
    cell = run_cell(Float(config), config, dict(network.weights), features)[1]
    torch.testing.assert_close(quick, cell, rtol=1e-12, atol=1e-12)
    wanted = torch.randn(cell.shape, generator=draws, dtype=torch.float64)
    weights = list(network.weights.values())
    for ours, its in zip(
        torch.autograd.grad((quick * wanted).sum(), weights),
        torch.autograd.grad((cell * wanted).sum(), weights),
        strict=True,
    ):
        torch.testing.assert_close(ours, its, rtol=1e-10, atol=1e-11)
