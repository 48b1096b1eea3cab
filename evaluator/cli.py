"""The command `wildscenes`: its local commands, and those that other parts of the distribution add."""

from __future__ import annotations

import json
import os
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import click
import numpy as np

from evaluator import __version__, report
from evaluator.benchmark import DEFAULT_ENCODING, Benchmark, load
from evaluator.build import build
from evaluator.demo import write_demo
from evaluator.errors import WildScenesError
from evaluator.evaluate import LISTED, Outcome, Task, evaluate
from evaluator.frames import read_facts
from evaluator.groundtruth import FACTS, GroundTruth
from evaluator.pack import pack
from evaluator.progress import watched
from evaluator.remote.commands import submit

PLUGINS = "wildscenes.commands"
REFUSED, USAGE = 1, 2


class Commands(click.Group):
    """A group that says what went wrong in a sentence, and finds more commands in the entry points."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Local commands and those of installed parts."""
        return sorted({*super().list_commands(ctx), *entry_points(group=PLUGINS).names})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name; an entry point is imported only when it is asked for."""
        found = super().get_command(ctx, cmd_name)
        if found is None and cmd_name in entry_points(group=PLUGINS).names:
            return _plugin(entry_points(group=PLUGINS)[cmd_name])
        return found

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 as click has it
        """Run a command; errors that are meant for people end it with a sentence and exit status 2."""
        try:
            return super().invoke(ctx)
        except (WildScenesError, OSError) as error:
            raise _UsageError(str(error)) from error


class _UsageError(click.ClickException):
    exit_code = USAGE


def _plugin(entry: EntryPoint) -> click.Command:
    try:
        command = entry.load()
    except ModuleNotFoundError as error:
        missing = error.name

        def explain() -> None:
            raise _UsageError(f"'{entry.name}' needs {missing}: pip install 'wildscenes[server]'")

        return click.Command(entry.name, callback=explain, help="Needs the extra wildscenes[server].", hidden=True)
    if not isinstance(command, click.Command):
        raise TypeError(entry.value)
    return command


def _benchmark(_ctx: click.Context, _param: click.Parameter, value: Path | None) -> Benchmark:
    try:
        return load(value)
    except WildScenesError as error:
        raise click.BadParameter(str(error)) from error


FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
OLD_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)

benchmark_option = click.option(
    "--benchmark",
    type=FILE,
    callback=_benchmark,
    help="A benchmark definition (TOML); WildScenes when omitted.",
)
track_option = click.option("--track", "track_id", required=True, help="The track, for example 2d-standard.")
labels_option = click.option(
    "--labels", "encoding", default=DEFAULT_ENCODING, show_default=True, help="The encoding that the labels are in."
)


@click.group(cls=Commands)
@click.version_option(__version__, package_name="wildscenes")
def main() -> None:
    """Score label maps of the WildScenes benchmark, locally or on an evaluation server."""


@main.command()
@benchmark_option
def tracks(benchmark: Benchmark) -> None:
    """List the tracks: what each is trained on, tested on, and what it scores."""
    for track in benchmark.all_tracks.values():
        protocol = track.protocol
        frames = protocol.frames.get(track.modality_id)
        click.echo(click.style(track.id, bold=True) + f"  {track.title}" + (f", {frames} frames" if frames else ""))
        click.echo(f"    trained on {protocol.trained_on}; tested on {', '.join(protocol.test_sequences)}")
        click.echo(f"    scores {', '.join(benchmark.names[i] for i in track.scored)}")


main.add_command(submit)


@main.group()
def groundtruth() -> None:
    """Pack and verify ground truth."""


@groundtruth.command("build")
@click.option("--data", type=OLD_FOLDER, required=True, help="The data set, in the WildScenes layout.")
@click.option("--splits", type=OLD_FOLDER, required=True, help="Holds opt2d/*.csv and opt3d/*.csv.")
@click.option("--out", type=FOLDER, required=True, help="The folder to make.")
@click.option("--open", "is_open", is_flag=True, help="These labels are public: everything may be shown.")
@click.option("--allow-absent", is_flag=True, help="Accept scored classes without ground truth (trials only).")
@benchmark_option
def build_groundtruth(  # noqa: PLR0913 each is an option
    data: Path, splits: Path, out: Path, benchmark: Benchmark, *, is_open: bool, allow_absent: bool
) -> None:
    """Pack the labels of a data set, and write its public facts beside them."""
    with watched("packing") as progress:
        release = build(data, splits, out, benchmark, is_open=is_open, allow_absent=allow_absent, progress=progress)
    for modality, totals in release.totals.items():
        click.echo(f"{modality}: {len(release.modalities[modality])} frames")
        for name, count in totals.items():
            click.echo(f"  {name:<16}{count:>16,}")
    click.echo(f"digest {release.groundtruth}")
    click.echo(f"public facts, to give away: {out / FACTS}")


@groundtruth.command("verify")
@click.argument("folder", type=OLD_FOLDER)
@benchmark_option
def verify_groundtruth(folder: Path, benchmark: Benchmark) -> None:
    """Unpack every frame and compare its digest."""
    truth = GroundTruth(folder, benchmark)
    wrong = truth.verify()
    for sentence in wrong[:LISTED]:
        click.echo(sentence)
    if wrong:
        sys.exit(REFUSED)
    click.echo(f"{sum(map(len, truth.release.modalities.values()))} frames, all intact; digest {truth.digest}")


@main.command()
@click.argument("archive", metavar="ZIP", type=FILE)
@track_option
@click.option("--groundtruth", "folder", type=OLD_FOLDER, help="Check against this packed release.")
@click.option("--facts", type=FILE, help="Check against the public facts of a release.")
@labels_option
@click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON.")
@benchmark_option
def validate(  # noqa: PLR0913 each is an option
    archive: Path,
    track_id: str,
    folder: Path | None,
    facts: Path | None,
    encoding: str,
    benchmark: Benchmark,
    *,
    as_json: bool,
) -> None:
    """Check a submission without scoring it. Exit status: 0 valid, 1 refused, 2 usage."""
    if folder and facts:
        raise click.UsageError("--groundtruth and --facts exclude each other")
    task = Task(benchmark, benchmark.track(track_id), encoding)
    known = GroundTruth(folder, benchmark).facts if folder else read_facts(facts, benchmark) if facts else None
    with watched("checking") as progress:
        outcome = evaluate(
            archive, task, known.frames(task.track) if known else None, jobs=os.cpu_count() or 1, progress=progress
        )
    if as_json:
        click.echo(json.dumps(report.refusal(outcome), indent=2))
    else:
        _say(outcome)
        if outcome.valid:
            click.echo(f"valid for {track_id}")
    sys.exit(0 if outcome.valid else REFUSED)


@main.command("evaluate")
@click.argument("archive", metavar="ZIP", type=FILE)
@track_option
@click.option("--groundtruth", "folder", type=OLD_FOLDER, required=True, help="A packed release.")
@labels_option
@click.option("--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Write the result here.")
@click.option("--per-frame", type=click.Path(dir_okay=False, path_type=Path), help="Write a matrix a frame (npz).")
@click.option("--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, help="Threads; all cores by default.")
@benchmark_option
def evaluate_archive(  # noqa: PLR0913 each is an option
    archive: Path,
    track_id: str,
    folder: Path,
    encoding: str,
    json_file: Path | None,
    per_frame: Path | None,
    jobs: int,
    benchmark: Benchmark,
) -> None:
    """Score a submission. Exit status: 0 scored, 1 refused, 2 usage."""
    truth = GroundTruth(folder, benchmark)
    task = Task(benchmark, benchmark.track(track_id), encoding)
    with watched("scoring") as progress:
        outcome = evaluate(archive, task, truth.frames(task.track), truth, jobs=jobs, progress=progress)
    _say(outcome)
    if not outcome.valid:
        if json_file:
            json_file.write_text(json.dumps(report.refusal(outcome), indent=2) + "\n", "utf-8")
        sys.exit(REFUSED)
    said = report.results(
        outcome.confusion.sum(axis=0), task.track, benchmark, digest=truth.digest, frames=len(outcome.frames)
    )
    if json_file:
        json_file.write_text(json.dumps(said, indent=2) + "\n", "utf-8")
    if per_frame:
        with per_frame.open("wb") as file:
            np.savez_compressed(file, frames=np.array(outcome.frames), confusion=outcome.confusion)
    click.echo(report.table(said))


def _say(outcome: Outcome) -> None:
    if outcome.warnings:
        click.echo(f"{len(outcome.warnings)} warnings:\n{report.listing(outcome.warnings)}", err=True)
    if outcome.problems:
        click.echo(f"{len(outcome.problems)} problems:\n{report.listing(outcome.problems)}", err=True)


@main.command("pack")
@click.argument("folder", type=OLD_FOLDER)
@track_option
@click.option("-o", "--out", type=click.Path(dir_okay=False, path_type=Path), required=True, help="The zip to write.")
@labels_option
@benchmark_option
def pack_folder(folder: Path, track_id: str, out: Path, encoding: str, benchmark: Benchmark) -> None:
    """Make a submission from a folder of PNG, .label, .npy or .txt files."""
    with watched("packing") as progress:
        packed = pack(folder, benchmark.track(track_id), out, encoding=encoding, benchmark=benchmark, progress=progress)
    for name in packed.skipped[:LISTED]:
        click.echo(f"skipped {name}", err=True)
    click.echo(f"{out}: {packed.members} members")


def _size(_ctx: click.Context, _param: click.Parameter, value: str) -> tuple[int, int]:
    width, cross, height = value.partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise click.BadParameter("expected WxH, for example 252x189")
    return int(width), int(height)


@main.command("demo-data")
@click.argument("folder", type=FOLDER)
@click.option("--frames", type=click.IntRange(1, 10_000), default=6, show_default=True, help="Test frames a sequence.")
@click.option("--size", default="252x189", show_default=True, callback=_size, help="Of the images, WxH in pixels.")
@click.option("--points", type=click.IntRange(200), default=4000, show_default=True, help="Of a cloud.")
@click.option("--seed", type=int, default=0, show_default=True)
@benchmark_option
def demo_data(  # noqa: PLR0913 each is an option
    folder: Path, frames: int, size: tuple[int, int], points: int, seed: int, benchmark: Benchmark
) -> None:
    """Write a small synthetic data set in the WildScenes layout, with its split files."""
    if folder.exists() and any(folder.iterdir()):
        raise _UsageError(f"{folder} is not empty")
    write_demo(folder, frames=frames, size=size, points=points, seed=seed, benchmark=benchmark)
    click.echo(f"{folder}: synthetic labels; its split files are in {folder / 'splits'}")


if __name__ == "__main__":
    main()
