"""Make the HTML page of a result folder again and print its summary.

Example: eskin report build/run
"""

from pathlib import Path

from eskin.cli.common import Options, argument, say, show_text


class ReportRequest(Options):
    folder: Path = argument("A folder that eskin run wrote.", metavar="DIR")


def command(request: ReportRequest) -> None:
    from eskin.pages.report import summary, write_report

    page = write_report(request.folder)
    show_text(summary(request.folder))
    say(f"report: {page}")
