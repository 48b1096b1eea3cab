"""The parts of a benchmark definition, as its TOML states them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

MAX_CLASSES, MAX_VALUES = 200, 254
"""Classes of a benchmark, and indices of an encoding: they fit a byte, and leave room for unlabelled and invalid."""

Name = Annotated[str, Field(min_length=1, pattern=r"^[\w.-]+$")]
Channel = Annotated[int, Field(ge=0, le=255)]


class Part(BaseModel):
    """A table of the TOML: every key is known, and of the right type."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class MergedClass(Part):
    """An annotated class that is scored as part of another one."""

    name: Name
    pixels: int
    definition: str


class SemanticClass(Part):
    """One class of the canonical space; `pixels` counts its annotated pixels in the 2D data set."""

    name: Name
    color: tuple[Channel, Channel, Channel]
    definition: str = ""
    pixels: int | None = None
    merged: tuple[MergedClass, ...] = ()


class Encoding(Part):
    """A label encoding: the class of each index in a file, "unlabelled", or "" where there is no such index."""

    title: str
    values: tuple[str, ...] = Field(max_length=MAX_VALUES)


class OfficialMean(Part):
    """A mean over more classes than ours, as an official script prints it.

    `name` is its key in JSON and `title` what pages call it. `baselines` names the tracks whose paper rows that script
    made; the classes that it adds count 0 in those.
    """

    name: Name
    title: str
    baselines: tuple[Name, ...] = ()
    add: tuple[Name, ...]


class Modality(Part):
    """Images or point clouds: how their files look in the data set."""

    title: str
    kind: Literal["image", "cloud"]
    splits: str
    groundtruth_encoding: Name
    suspects: tuple[Name, ...] = ()
    official_mean: OfficialMean | None = None

    @property
    def suffix(self) -> str:
        """The extension of a label file, in lower case."""
        return ".png" if self.kind == "image" else ".label"


class Sequence(Part):
    """One traversal."""

    name: Name
    environment: str = ""
    date: str = ""
    season: str = ""


class Protocol(Part):
    """What is trained on and what is scored."""

    id: Name
    title: str
    split: Literal["test", "val"]
    test_sequences: tuple[Name, ...]
    train_sequences: tuple[Name, ...] = ()
    trained_on: str = ""
    ranked: bool = True
    not_scored: dict[str, tuple[Name, ...]] = Field(default_factory=dict)
    frames: dict[str, int] = Field(default_factory=dict)


class TrackEntry(Part):
    """The identity of a track."""

    id: Name
    modality: Name
    protocol: Name


class Baseline(Part):
    """A row that a paper printed, in percent; a class that is missing was not scored."""

    track: Name
    method: str
    backbone: str = ""
    note: str = ""
    table: int
    miou: float
    iou: dict[str, float]

    @property
    def title(self) -> str:
        """The method with its backbone."""
        return f"{self.method} ({self.backbone})" if self.backbone else self.method


class Limits(Part):
    """Bounds on what one submission may hold."""

    max_members: int = 50_000
