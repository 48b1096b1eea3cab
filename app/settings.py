"""Settings, each from an environment variable `WILDSCENES_<NAME>`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Everything that a host may set; the defaults are the embedded mode's."""

    model_config = SettingsConfigDict(env_prefix="WILDSCENES_", extra="ignore")

    home: Path = Field(Path("var"), description="Folder of the database, uploads and packed ground truth.")
    database_url: str = Field("", description="SQLAlchemy URL; SQLite in the home folder when empty.")
    broker_url: str = Field("", description="Redis or Valkey; the embedded one's socket when empty.")
    base_url: str = Field("http://127.0.0.1:8000", description="The address that people use, for links.")
    benchmarks: list[Path] = Field([], description="Benchmark definitions (JSON list); WildScenes when empty.")
    groundtruth: Path | None = Field(None, description="Folder of packed releases; in the home folder when empty.")
    max_upload_bytes: int = Field(2_000_000_000, gt=0, description="Largest upload that is accepted.")
    scoring_threads: int = Field(2, gt=0, description="Threads that score inside one worker process.")
    scoring_memory_bytes: int = Field(4_000_000_000, gt=0, description="Memory of a process that scores (Linux).")
    scoring_seconds: int = Field(3600, gt=0, description="Time after which a process that scores is ended.")
    chunk_frames: int = Field(16, gt=0, description="Frames scored between two commits.")
    lease_seconds: float = Field(30, gt=0, description="How long a silent worker keeps its claim.")
    heartbeat_seconds: float = Field(5, gt=0, description="How often a worker renews its claim.")
    sweep_seconds: float = Field(5, gt=0, description="How often lost work is looked for.")
    resend_seconds: float = Field(30, gt=0, description="When a waiting evaluation is sent to the queue again.")
    deaf_seconds: float = Field(90, gt=0, description="When an idle worker beside waiting work restarts itself.")
    receiving_seconds: float = Field(300, gt=0, description="Silence after which an upload is given up.")

    @property
    def database(self) -> str:
        """The database's URL."""
        return self.database_url or f"sqlite:///{(self.home / 'wildscenes.sqlite').resolve()}"

    @property
    def releases(self) -> Path:
        """The folder of packed ground truth."""
        return self.groundtruth or self.home / "groundtruth"

    @property
    def uploads(self) -> Path:
        """The folder of uploaded zips."""
        return self.home / "uploads"
