"""Commands that talk to a server."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from evaluator.progress import watched


@click.command()
@click.argument("archive", metavar="ZIP", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--track", required=True, help="The track, for example 2d-standard.")
@click.option("--method", required=True, help="The method's name; a new one is made on first use.")
@click.option("--server", required=True, envvar="WILDSCENES_SERVER", help="The server's address.")
@click.option("--token", required=True, envvar="WILDSCENES_TOKEN", help="An API token with scope submit.")
@click.option("--labels", default="benchmark", show_default=True, help="The encoding that the labels are in.")
@click.option("--public", is_flag=True, help="Show it on the leaderboard once it is scored.")
@click.option("--wait", is_flag=True, help="Wait for the scores and print them.")
def submit(  # noqa: PLR0913 each is an option
    archive: Path, track: str, method: str, server: str, token: str, labels: str, *, public: bool, wait: bool
) -> None:
    """Upload a submission. Exit status: 0 sent (or scored, with --wait), 1 refused, 2 usage or connection."""
    from evaluator.remote.client import Client  # noqa: PLC0415 local commands should not wait for the HTTP library

    client = Client(server, token)
    fields = {
        "track": track,
        "method": method,
        "labels": labels,
        "visibility": "public" if public else "private",
    }
    with watched("sending") as sent:
        submission = client.submit(archive, fields, sent)
    click.echo(submission["links"]["html"])
    if wait:
        with watched("scoring") as moved:
            submission = client.wait(submission["id"], moved)
        click.echo(summary(submission))
        sys.exit(0 if submission["state"] == "scored" else 1)


def summary(submission: dict[str, Any]) -> str:
    """What became of a submission, for a terminal."""
    lines = [f"{submission['state']}: {submission['method']} on {submission['track']}"]
    for problem in submission["problems"]:
        where = f"{problem['member']}: " if problem["member"] else ""
        said = f" (expected {problem['expected']}, found {problem['found']})" if problem["found"] else ""
        lines.append(f"{where}{problem['code']}{said}. {problem['hint']}")
    left = submission["problems_total"] - len(submission["problems"])
    lines += [f"... and {left} more"] if left > 0 else []
    lines += [f"warning: {w['member'] or ''} {w['code']}. {w['hint']}" for w in submission["warnings"]]
    scores = submission["scores"]
    if scores:
        lines += [f"{name:<16}{_percent(iou):>8}" for name, iou in scores["classes"].items()]
        lines.append(f"{'mIoU':<16}{_percent(scores['miou'], 2):>8}")
    return "\n".join(lines)


def _percent(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{100 * value:.{digits}f}"
