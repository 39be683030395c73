"""The methods of the thesis this project starts from (M. Alameh, table 3.1) on recordings of yours, judged on
the folds of our networks: the table, and baselines.json.

    python examples/thesis/run.py --data recordings.npz --group person --out build/thesis

GRU and LSTM are trained under the thesis's protocol: N windows, each overlapping the next by half, over the
whole touch; their means alone, one mean and one scale for all taxels; a loss on the last step, which decides;
Adam, 1200 batches of 48 (the thesis: 96 epochs). Two things are not the thesis's: the rest level is removed because it
reveals the session (docs/results.md), and mean and scale come from the training part alone.

The DCNN needs a network that was trained on photographs: images (1, 3, side, side) to values (1, n), the side
a multiple of 32. With torchvision, for one:

    seen = torchvision.models.mobilenet_v2(weights="DEFAULT").eval()
    seen.classifier = torch.nn.Identity()
    sides = {2: torch.export.Dim.AUTO, 3: torch.export.Dim.AUTO}
    program = torch.export.export(seen, (torch.zeros(1, 3, 96, 96),), dynamic_shapes=(sides,))
    torch.export.save(program, "seen.pt2")
"""

import argparse
import sys
from functools import partial
from pathlib import Path

from baselines import Network, run
from images import OVER_TIME, Transfer
from tensor import TENSOR

from eskin.data import load_recordings
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.training.derive import derive_config, for_recordings
from eskin.training.formats import with_network
from eskin.training.recipe import Recipe, choose_recipe

STEPS = (20, 50, 100, 200, 256)
"""Windows of a touch that the thesis tries."""

PROTOCOL = Recipe(name="thesis", loss="last", updates=1200, batch=48, learning_rate=0.001, one_cycle=False)
"""The published protocol with Adam's usual rate, as the thesis names none, and as many updates as 96 epochs of 600
touches."""


def thesis_network(
    config: AcceleratorConfig, cell: str, hidden: int, steps: int
) -> tuple[AcceleratorConfig, Recipe]:
    """``config`` with the windows, features and decision of the thesis over the same touch; its recipe.

    Raises
    ------
    InputError
        The touch has too few frames for the windows.
    """
    plain = config.replace(feature_kinds=("mean",), feature_scale="array", feature_shift=(), decision="last")
    if config.windows.window_mode == "touch":
        return with_network(plain, cell=cell, hidden=hidden, steps=steps), PROTOCOL
    hop = config.last_frame // (steps + 1)
    if not hop:
        raise InputError(f"{steps} windows: a touch has {config.last_frame} frames; take fewer windows")
    cut = plain.replace(hop=hop, window=2 * hop, steps=steps)
    return with_network(cut, cell=cell, hidden=hidden), PROTOCOL


RECURRENT = tuple(
    Network(
        f"{cell}{hidden}-n{steps}",
        f"{cell.upper()}{steps}, {hidden} neurons, thesis's protocol",
        partial(thesis_network, cell=cell, hidden=hidden, steps=steps),
    )
    for steps in STEPS
    for cell, hidden in (("gru", 12), ("gru", 10), ("lstm", 10))
)


def our_network(config: AcceleratorConfig) -> tuple[AcceleratorConfig, Recipe]:
    """A GRU of 12 on all features of ``config``; the recipe of `eskin train`."""
    changed = with_network(config, cell="gru", hidden=12)
    return changed, choose_recipe(changed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", required=True, help="recordings, as every verb of eskin takes them")
    parser.add_argument("--config", help="a preset or a JSON file; default: derived from the recordings")
    parser.add_argument("--group", default="", help="group arrays A[,B..]; default: random folds")
    parser.add_argument("--out", type=Path, default=Path("build/thesis"))
    parser.add_argument("--methods", help="some of them, A,B,...; default: all")
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--seeds", type=int, default=3, help="the thesis has 10")
    parser.add_argument("--dcnn", type=Path, help="also the DCNN: a network that torch.export.save wrote")
    arguments = parser.parse_args()
    transfer = [Transfer("dcnn", "DCNN by transfer, one image", arguments.dcnn)] if arguments.dcnn else []
    methods = {method.name: method for method in (*RECURRENT, *TENSOR, *OVER_TIME, *transfer)}
    names = arguments.methods.split(",") if arguments.methods else list(methods)
    if unknown := [name for name in names if name not in methods]:
        parser.error(f"--methods {unknown[0]}: is none of {', '.join(methods)}")
    try:
        recordings = load_recordings(arguments.data)
        config = (
            for_recordings(AcceleratorConfig.load(arguments.config), recordings) if arguments.config else None
        )
        result = run(
            recordings,
            config or derive_config(recordings)[0],
            [*map(methods.__getitem__, names), Network("gru", "GRU 12, our recipe", our_network)],
            arguments.group.split(",") if arguments.group else [],
            arguments.out,
            folds=arguments.folds,
            seeds=arguments.seeds,
            progress=lambda what, done, total: print(f"{what}: {done} of {total}", file=sys.stderr),
        )
    except InputError as error:
        parser.exit(2, f"{error}\n")
    print("| method | unseen | accuracy (%) | multiplies | parameters |\n| --- | --- | --: | --: | --: |")
    for row in result["rows"]:
        accuracy = f"{100 * row['accuracy']:.1f} ± {100 * row['spread']:.1f}"
        print(f"| {row['label']} | {row['split']} | {accuracy} | {row['multiplies']} | {row['parameters']} |")


if __name__ == "__main__":
    main()
