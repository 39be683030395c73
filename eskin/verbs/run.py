"""Do the whole job once, in one folder: choose, train, quantise, evaluate, generate, co-simulate,
report.

Example: eskin run --data recordings.npz --recordings 40 --out result
"""

from pathlib import Path

from eskin.cli.common import DATA, ChoiceOptions, messages, option, parse_count, say, show_text
from eskin.golden.core import Result


class RunRequest(ChoiceOptions):
    data: str = option(DATA, "synthetic")
    recordings: str | None = option("Recordings to co-simulate. Default: 8 per class.", metavar="N|all")
    out: Path = option("Result folder: new, or an earlier result to replace.", Path("build/run"))
    test: str | None = option("Recordings held back, used once for a separate accuracy.", metavar="HELD")
    name: str | None = option("Title of the report. Default: name of the data.")

    @property
    def count(self) -> int | None:
        """The number of ``recordings``; None where it is not given."""
        return None if self.recordings is None else parse_count(self.recordings)


def command(request: RunRequest) -> Result:
    from eskin.pages.report import PAGE, summary
    from eskin.verbs.run_job import run

    record = run(request, messages)
    show_text(summary(request.out))
    say(f"report: {request.out / PAGE}")
    return record
