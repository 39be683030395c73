"""Recurrent networks as people write them with torch."""

import torch


class Network(torch.nn.Module):
    """A layer of torch or its cell, and a readout behind every step or the last one; steps or batch first."""

    def __init__(
        self, layer: str, inputs: int = 4, hidden: int = 6, *, last: bool = False, batch_first: bool = True
    ) -> None:
        super().__init__()
        torch.manual_seed(3)
        order = {} if layer.endswith("Cell") else {"batch_first": batch_first}
        self.recurrent = getattr(torch.nn, layer)(inputs, hidden, **order)
        self.head, self.last, self.batch_first = torch.nn.Linear(hidden, 3), last, batch_first

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if isinstance(self.recurrent, torch.nn.RNNCellBase):
            by_step, state = [], None
            for step in x.unbind(1):
                state = self.recurrent(step, state)
                by_step.append(state[0] if isinstance(state, tuple) else state)
            states = torch.stack(by_step, dim=1)
        else:
            states = self.recurrent(x)[0]
        if self.last:
            states = states[:, -1] if self.batch_first else states[-1]
        return self.head(states)
