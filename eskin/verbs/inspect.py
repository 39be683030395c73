"""Show the content of an archive: taxels, rate, lengths, classes, groups, the onset of each recording,
a picture.

Example: eskin inspect recordings.npz --json archive.json
"""

from pathlib import Path

from eskin.cli.common import DATA, JsonOptions, argument, load_data, option, show, show_text
from eskin.golden.core import InputError, Record, check_target
from eskin.pages.views import short_name, words, write_text


class InspectRequest(JsonOptions):
    data: str = argument(DATA)
    out: Path | None = option("Picture to write. Default: build/inspect/NAME.png.")
    card: bool = option(
        "Also write a data card, README.md, in a folder named like the picture.", False, "--card"
    )


def command(request: InspectRequest) -> Record:
    from eskin.pages.inspect_data import draw, in_rows
    from eskin.pages.inspect_data import inspect as look

    picture = request.out or Path("build/inspect") / f"{short_name(request.data)}.png"
    if picture.suffix != ".png":
        raise InputError(f"--out {picture}: must end in .png; give such a name")
    check_target(picture)
    readme = picture.with_suffix("") / "README.md"
    if request.card and readme.exists():
        raise InputError(f"{readme}: exists already and may be filled in; move it, or give another --out")
    recordings, _ = load_data(request.data)
    figures = look(recordings)
    draw(recordings, figures.get("onset_frames"), picture)
    more = {} if recordings.image_shape else in_rows(recordings, figures, request.data)
    show("inspect", **figures, **more, picture=picture)
    if request.card:
        write_text(readme, words("card", held=recordings, name=short_name(request.data), **figures))
        show_text(f"data card: {readme}; replace each TO FILL IN")
    return figures
