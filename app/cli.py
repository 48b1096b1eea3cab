"""The commands that run and administer a server."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from uuid import UUID

import click

from app import demo as demo_data
from app.accounts.models import Role, Scope
from app.accounts.service import create_person
from app.accounts.service import create_token as make_token
from app.database import migrate
from app.errors import Refusal
from app.settings import Settings
from app.submissions import service
from app.submissions.lifecycle import State
from app.supervisor import StartError, Supervisor
from app.tracks.service import import_release
from app.wiring import Wired, wire
from evaluator.groundtruth import RELEASE, Release

home_option = click.option(
    "--home",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("var"),
    show_default=True,
    envvar="WILDSCENES_HOME",
    help="The server's folder: database, uploads, ground truth.",
)


class Administration(click.Group):
    """A group whose refusals end with a sentence."""

    def invoke(self, ctx: click.Context) -> object:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except Refusal as refusal:
            raise click.ClickException(refusal.detail) from refusal


def opened(home: Path) -> Wired:
    """The service on a home folder, its tables up to date."""
    home.mkdir(parents=True, exist_ok=True)
    settings = Settings(home=home)
    migrate(settings.database)
    return wire(settings)


@click.command()
@home_option
@click.option("--host", default="127.0.0.1", show_default=True, help="The address to listen on.")
@click.option("--port", type=click.IntRange(1, 65535), default=8000, show_default=True)
@click.option(
    "--groundtruth",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A packed release to use from now on.",
)
@click.option(
    "--benchmark",
    "benchmarks",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A benchmark definition; may be repeated. WildScenes when omitted.",
)
@click.option("--base-url", help="The address that people use; made from host and port when omitted.")
@click.option("--demo", is_flag=True, help="Make synthetic ground truth and a few submissions on first use.")
def serve(  # noqa: PLR0913 each is an option
    home: Path,
    host: str,
    port: int,
    groundtruth: Path | None,
    benchmarks: tuple[Path, ...],
    base_url: str | None,
    *,
    demo: bool,
) -> None:
    """Run web, worker and broker on this machine until Ctrl-C; they run as one user, with no boundary between them."""
    environment = {
        "WILDSCENES_HOME": str(home.resolve()),
        "WILDSCENES_BASE_URL": base_url or f"http://{host}:{port}",
    }
    if benchmarks:
        environment["WILDSCENES_BENCHMARKS"] = "[" + ",".join(f'"{path.resolve()}"' for path in benchmarks) + "]"
    home.mkdir(parents=True, exist_ok=True)
    try:
        supervisor = Supervisor(home, host=host, port=port, environment=environment)
        os.environ.update(environment, WILDSCENES_BROKER_URL=supervisor.broker_url)
        wired = opened(home)
        if groundtruth:
            _use(wired, groundtruth)
        supervisor.start()
    except StartError as error:
        raise click.ClickException(str(error)) from error
    try:
        click.echo(f"\nWildScenes evaluation server: {wired.settings.base_url} (listening on {host}:{port})")
        if demo:
            folder = home / "demo"
            token = demo_data.prepare(wired, folder)
            click.echo(f"\nToken of the demo account (sign in with it): {token}")
            click.echo(f"\nSubmit a sample:\n\n{demo_data.curl_line(wired, folder, token)}\n")
        click.echo(f"Logs are in {home / 'logs'}. Ctrl-C stops the server.")
        wired.db.dispose()
        supervisor.watch()
        click.echo("stopping …")
    finally:
        supervisor.stop()


def _use(wired: Wired, groundtruth: Path) -> None:
    try:
        name = Release.model_validate_json((groundtruth / RELEASE).read_bytes()).benchmark
    except (OSError, ValueError) as error:
        raise click.ClickException(f"{groundtruth} holds no packed ground truth") from error
    if name not in wired.benchmarks:
        raise click.ClickException(f"{groundtruth} is of benchmark {name!r}, which this server does not have")
    digest = import_release(wired.db, wired.settings.releases, groundtruth, wired.benchmarks[name], now=wired.now())
    click.echo(f"ground truth {digest}")


@click.group(cls=Administration)
def admin() -> None:
    """Administer a server from its own machine."""


@admin.command("create-user")
@click.argument("email")
@click.option("--role", type=click.Choice([one.value for one in Role]), default=Role.MEMBER.value, show_default=True)
@click.option("--name", help="What boards show; the address's first part when omitted.")
@home_option
def create_user(email: str, role: str, name: str | None, home: Path) -> None:
    """Make an account that is ready to use."""
    wired = opened(home)
    person = create_person(wired.db, email=email, role=Role(role), name=name, now=wired.now())
    click.echo(f"{person.email}: {person.role.value}")


@admin.command("create-token")
@click.argument("email")
@click.option("--scope", type=click.Choice([one.value for one in Scope]), default=Scope.SUBMIT.value, show_default=True)
@home_option
def create_token(email: str, scope: str, home: Path) -> None:
    """Print a new token, and nothing else."""
    wired = opened(home)
    click.echo(make_token(wired.db, email=email, scope=Scope(scope), now=wired.now()))


@admin.command("import-groundtruth")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@home_option
def import_groundtruth(folder: Path, home: Path) -> None:
    """Verify a packed release, keep a copy of it, and score against it from now on."""
    _use(opened(home), folder)


@admin.command("list")
@click.option("--state", type=click.Choice([one.value for one in State]), help="Only those in this state.")
@home_option
def list_submissions(state: str | None, home: Path) -> None:
    """List the newest submissions."""
    for submission, method in service.newest(opened(home), state=State(state) if state else None):
        when = f"{submission.created_at:%Y-%m-%d %H:%M}"
        seen = "hidden" if submission.hidden else submission.visibility.value
        click.echo(f"{submission.id}  {when}  {submission.state.value:<9}  {seen:<7}  {submission.track:<24}  {method}")


@admin.command()
@click.argument("submission", type=click.UUID)
@home_option
def rerun(submission: UUID, home: Path) -> None:
    """Score a failed submission again."""
    service.rerun(opened(home), submission)
    click.echo(f"{submission}: queued")


@admin.command()
@click.argument("submission", type=click.UUID)
@click.option("--undo", is_flag=True, help="Show it again.")
@home_option
def hide(submission: UUID, home: Path, *, undo: bool) -> None:
    """Take a submission off the boards."""
    service.hide(opened(home), submission, hidden=not undo)
    click.echo(f"{submission}: {'shown' if undo else 'hidden'}")


if __name__ == "__main__":
    sys.exit(admin())
