"""The figures of docs/baselines.md from results of ``eskin baselines``, and its charts.

    python -m scripts.baselines_page "pvdf:PVDF taxels on 5 objects=build/pvdf,build/pvdf_full" "fabric:7
    fabrics=build/fabric"

NAME:TITLE=FOLDER[,FOLDER..] each: folders of one scene are joined, row by row (another set of methods, more
seeds). What stands between the two marks of the page is replaced, and docs/baselines_NAME.svg written.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eskin.golden.core import InputError, Record, replacing, template
from eskin.pages.baselines_chart import chart
from eskin.rtl.views.schedule_view import save_figure
from eskin.study.baselines.rows import nearest, orders

PAGE = Path("docs/baselines.md")
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"


@dataclass(frozen=True)
class Scene:
    """One scene's results: name (of the chart's file), title, rows (``eskin.study.baselines.rows.row_of``),
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

    @property
    def labels(self) -> dict[str, str]:
        """What the methods are called."""
        return {row["method"]: row["label"] for row in self.rows}

    @property
    def methods(self) -> list[tuple[dict[str, Record], Record, dict[str, float]]]:
        """Of each method, the best on average first: its rows by split, the first of them, and the means of
        its figures over the splits."""
        methods = []
        for name in self.labels:
            rows = {row["split"]: row for row in self.rows if row["method"] == name}
            first = next(iter(rows.values()))
            means = {
                key: sum(row[key] or 0.0 for row in rows.values()) / len(rows)
                for key, figure in first.items()
                if isinstance(figure, int | float | None)
            }
            methods.append((rows, first, means))
        return sorted(methods, key=lambda method: -method[2]["accuracy"])


def figures(scenes: Sequence[Scene]) -> str:
    """The part of the page between the marks."""
    filled = template(__file__, "baselines.md", percent=lambda share: f"{100 * share:.1f}")
    return filled.render(scenes=scenes, nearest=nearest, orders=orders).rstrip("\n")


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
