"""The figures of docs/baselines.md from results of ``eskin baselines``, and its charts.

    python -m scripts.baselines_page "pvdf:PVDF taxels on 5 objects=build/pvdf,build/pvdf_full" "fabric:7
    fabrics=build/fabric"

NAME:TITLE=FOLDER[,FOLDER..] each: folders of one scene are joined, row by row (another set of methods, more
seeds). What stands between the two marks of the page is replaced, and docs/baselines_NAME.svg written.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eskin.golden.baselines.rows import nearest, orders
from eskin.golden.core import InputError, Record, replacing
from eskin.pages.baselines_chart import chart
from eskin.rtl.views.schedule_view import save_figure

PAGE = Path("docs/baselines.md")
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"
ORDERS = """## Does the thesis's order hold?

It finds GRU and LSTM with 20 windows better than with 256, and better than the tensor methods. In float, as there. An order is told where
the difference, in points, is more than its standard error over the folds: with so few folds weak evidence.
"""
VERDICT = {True: "holds", False: "does not hold", None: "not told apart"}


@dataclass(frozen=True)
class Scene:
    """One scene's results: name (of the chart's file), title, rows (``eskin.golden.baselines.rows.row_of``),
    recordings, and what was left out (method, split, reason)."""

    name: str
    title: str
    rows: list[Record]
    recordings: int
    left_out: list[Record]

    @classmethod
    def read(cls, argument: str) -> Scene:
        """From NAME:TITLE=FOLDER[,FOLDER..]; of a method on a split that is in two folders, the later one's
        row.

        Raises
        ------
        InputError
            Another form, a folder without baselines.json, folders of different recordings or front ends.
        """
        names, _, folders = argument.rpartition("=")
        name, _, title = names.partition(":")
        if not (name and title and folders):
            raise InputError(f"'{argument}': is not NAME:TITLE=FOLDER[,FOLDER..]")
        results = []
        for folder in folders.split(","):
            file = Path(folder) / "baselines.json"
            if not file.is_file():
                raise InputError(
                    f"'{folder}': holds no baselines.json; make it with 'eskin baselines --out {folder}'"
                )
            results.append(json.loads(file.read_text()))
        if any(
            result[key] != results[0][key]
            for result in results
            for key in ("recordings", "classes", "config", "shape", "folds")
        ):
            raise InputError(f"'{argument}': the folders are of different recordings, folds or front ends")
        rows = {(row["split"], row["method"]): row for result in results for row in result["rows"]}
        left = {(row["split"], row["method"]): row for result in results for row in result["left_out"]}
        return cls(name, title, list(rows.values()), results[0]["recordings"], list(left.values()))

    @property
    def splits(self) -> list[str]:
        """Splits in the order of the results."""
        return list(dict.fromkeys(row["split"] for row in self.rows))

    def of(self, split: str) -> list[Record]:
        """Rows of one split."""
        return [row for row in self.rows if row["split"] == split]


def percent(share: float) -> str:
    """A share with one decimal."""
    return f"{100 * share:.1f}"


def table(scene: Scene) -> Iterator[str]:
    """Every method a line, the best on average first; costs are means over the splits."""
    yield f"### {scene.title[0].upper() + scene.title[1:]}, {scene.recordings} recordings\n"
    splits = " | ".join(f"unseen {split} (%)" for split in scene.splits)
    yield f"| method | seeds | {splits} | multiplies | parameters | bytes | train (s) | decision (us), 99 % | hardware |"
    yield "| :-- | --: |" + " --: |" * (len(scene.splits) + 5) + " :-- |"
    by_method: dict[str, dict[str, Record]] = {}
    for row in scene.rows:
        by_method.setdefault(row["method"], {})[row["split"]] = row
    for rows in sorted(
        by_method.values(), key=lambda rows: -sum(row["accuracy"] for row in rows.values()) / len(rows)
    ):
        yield _line(scene, rows)
    yield ""
    for row in scene.left_out:
        yield f"Left out, {row['method']} on unseen {row['split']}: {row['reason']}.\n"
    yield f"![accuracy against multiplies of a decision, {scene.title}](baselines_{scene.name}.svg)\n"


def _line(scene: Scene, rows: dict[str, Record]) -> str:
    first = next(iter(rows.values()))

    def mean(key: str) -> float:
        return sum(row[key] or 0.0 for row in rows.values()) / len(rows)

    cost = f"{mean('multiplies'):.0f}" if first["multiplies"] else f"0, {mean('comparisons'):.0f} comparisons"
    shares = [
        f"{percent(rows[s]['accuracy'])} ± {percent(rows[s]['spread'])}" if s in rows else ""
        for s in scene.splits
    ]
    figures = [cost, f"{mean('parameters'):.0f}", f"{mean('bytes'):.0f}", f"{mean('train_s'):.2g}"]
    figures.append(f"{mean('decision_us'):.0f}, {mean('decision_us_99'):.0f}")
    return f"| {' | '.join([first['label'], str(first['seeds']), *shares, *figures])} | {'yes' if first['hardware'] else ''} |"


def near(scene: Scene) -> Iterator[str]:
    """Of each split the best method, and the smallest network in hardware within a point of it."""
    labels = {row["method"]: row["label"] for row in scene.rows}
    for split in scene.splits:
        choice = nearest(scene.of(split))
        best = f"{labels[choice['best']]}, {percent(choice['best_accuracy'])} %"
        if choice["network"] is None:
            yield f"| {scene.title} | {split} | {best} | - | - |"
            continue
        network = (
            f"{labels[choice['network']]}, {percent(choice['accuracy'])} %, {choice['multiplies']} multiplies"
        )
        within = "yes" if choice["within"] else f"no: {percent(choice['gap'])} points below"
        yield f"| {scene.title} | {split} | {best} | {network} | {within} |"


def held(scene: Scene) -> Iterator[str]:
    """The thesis's orders on each split."""
    for split in scene.splits:
        for order in orders(scene.of(split)):
            sides = [
                f"{order[side]['method']} {percent(order[side]['accuracy'])} ± "
                f"{percent(order[side]['spread'])} %"
                for side in ("above", "below")
            ]
            apart = f"{100 * order['difference']:+.1f} ± {percent(order['standard_error'])}"
            yield f"| {scene.title}, {split} | {order['order']} | {sides[0]} | {sides[1]} | {apart} | {VERDICT[order['holds']]} |"


def figures(scenes: Sequence[Scene]) -> str:
    """The part of the page between the marks."""
    lines = [
        "| recordings | unseen | best of all | smallest in hardware within a point of it | within |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [line for scene in scenes for line in near(scene)]
    lines += ["", *(line for scene in scenes for line in table(scene))]
    lines += [ORDERS]
    lines += [
        "| recordings, unseen | order | first | second | difference | here |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [line for scene in scenes for line in held(scene)]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Writes the figures of docs/baselines.md and its charts.")
    parser.add_argument("scenes", nargs="+", metavar="NAME:TITLE=FOLDER[,FOLDER..]")
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args()
    try:
        scenes = [Scene.read(argument) for argument in options.scenes]
        before, begin, rest = options.page.read_text().partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise InputError(f"'{options.page}': lacks the marks {BEGIN} and {END}")
    except InputError as error:
        parser.exit(2, f"{error}\n")
    for scene in scenes:
        with replacing(options.page.parent / f"baselines_{scene.name}.svg") as temporary:
            save_figure(chart({"rows": scene.rows}), "svg")(temporary)
    with replacing(options.page) as temporary:
        temporary.write_text(f"{before}{BEGIN}\n{figures(scenes)}\n{END}{after}")


if __name__ == "__main__":
    main()
