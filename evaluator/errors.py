"""Every way in which a submission can be wrong, each with a stable code, what it means and what to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum


class Code(str, Enum):
    """The stable name of a problem or a warning, as reports and the API print it."""

    # The archive as a whole: nothing after it can be trusted.
    NOT_A_ZIP = "not_a_zip"
    DAMAGED_ARCHIVE = "damaged_archive"
    TOO_MANY_MEMBERS = "too_many_members"
    OVERLAPPING_MEMBERS = "overlapping_members"
    UNSAFE_NAME = "unsafe_name"
    SPECIAL_FILE = "special_file"
    ENCRYPTED_MEMBER = "encrypted_member"
    UNSUPPORTED_COMPRESSION = "unsupported_compression"
    # One frame or one member.
    MISSING_FRAME = "missing_frame"
    NO_FRAME_NAMED = "no_frame_named"
    DUPLICATE_FRAME = "duplicate_frame"
    WRONG_SEQUENCE = "wrong_sequence"
    WRONG_TYPE = "wrong_type"
    WRONG_SIZE = "wrong_size"
    WRONG_POINT_COUNT = "wrong_point_count"
    UNREADABLE = "unreadable"
    NOT_INDICES = "not_indices"
    INTERLACED = "interlaced"
    VALUE_OUT_OF_RANGE = "value_out_of_range"
    # Warnings: they do not refuse a submission.
    UNKNOWN_MEMBER = "unknown_member"
    LOOKS_LIKE_OTHER_ENCODING = "looks_like_other_encoding"
    CHECKED_WITHOUT_FACTS = "checked_without_facts"


ARCHIVE_FAULTS = frozenset(list(Code)[: list(Code).index(Code.MISSING_FRAME)])
"""Codes that refuse the archive at once."""

HINTS: dict[Code, str] = {
    Code.NOT_A_ZIP: "Send one zip archive, for example the one that `wildscenes pack` writes.",
    Code.DAMAGED_ARCHIVE: "The archive is cut off or damaged; make it again and compare its size before you send it.",
    Code.TOO_MANY_MEMBERS: "Send the frames of one track only.",
    Code.OVERLAPPING_MEMBERS: "Members share bytes; make the archive again with an ordinary zip tool.",
    Code.UNSAFE_NAME: "Use plain relative names without '..', drive letters, backslashes or control characters.",
    Code.SPECIAL_FILE: "Put the files themselves into the archive, not links (`zip` without `-y`).",
    Code.ENCRYPTED_MEMBER: "Make the archive without a password.",
    Code.UNSUPPORTED_COMPRESSION: "Use ordinary zip compression (deflate) or none.",
    Code.NO_FRAME_NAMED: (
        "A member is told by its file name, which must be the frame's (the track's facts list them): "
        "no prefix, no suffix, and the frames of this track."
    ),
    Code.MISSING_FRAME: "Every frame of the track is needed; predict this one too.",
    Code.DUPLICATE_FRAME: "Two members claim this frame; keep one of them.",
    Code.WRONG_SEQUENCE: "The folder names another sequence than this frame's own; check how names were written.",
    Code.WRONG_TYPE: "The name is a frame's, the file type not this track's; `wildscenes pack` converts .npy and .txt.",
    Code.WRONG_SIZE: "Resize the label map to the image's size with nearest-neighbour interpolation.",
    Code.WRONG_POINT_COUNT: "Map voxel or clipped labels back to every point of the cloud, in its order.",
    Code.UNREADABLE: "The file is damaged or is not what its name says; write it again.",
    Code.NOT_INDICES: "This looks painted; save the class indices as an 8-bit greyscale or palette PNG.",
    Code.INTERLACED: "Save the PNG without interlacing.",
    Code.VALUE_OUT_OF_RANGE: "Write class indices of the named label encoding, or 255 for unlabelled.",
    Code.UNKNOWN_MEMBER: "It is no frame of this track and was ignored.",
    Code.LOOKS_LIKE_OTHER_ENCODING: "Name the encoding that the labels are really in.",
    Code.CHECKED_WITHOUT_FACTS: (
        "Only layout, decoding and values were checked. To check names and sizes too, give --groundtruth, or --facts "
        "with what the server's /api/v1/tracks/TRACK/facts answers."
    ),
}


LONGEST = 300
"""Characters of a text in a problem."""


def printable(text: str) -> str:
    """A text that cannot steer a page or a terminal: what cannot be seen is replaced, and what is long is cut."""
    cut = text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
    if cut.isprintable():
        return cut
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in cut)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong (or, as a warning, odd) with a submission.

    Attributes:
        code: which rule.
        member: the member's name in the archive, or the frame's name where no member exists; None for the archive.
        expected: what the rule asks for, in words.
        found: what was there, in words.
        hint: what to do about it.
    """

    code: Code
    member: str | None = None
    expected: str | None = None
    found: str | None = None
    hint: str | None = None

    def __post_init__(self) -> None:
        """Make every text fit for a page or a terminal: whoever made the archive has a say in most of them."""
        for name in ("member", "expected", "found", "hint"):
            text = getattr(self, name)
            if text is not None:
                object.__setattr__(self, name, printable(text))

    def as_json(self) -> dict[str, str | None]:
        """The problem as JSON; a hint is always present."""
        return {
            "member": self.member,
            "code": self.code.value,
            "expected": self.expected,
            "found": self.found,
            "hint": self.hint or HINTS[self.code],
        }

    def as_row(self) -> dict[str, str | None]:
        """The problem exactly as it is, to be kept; the inverse is `from_row`."""
        return {**asdict(self), "code": self.code.value}

    @classmethod
    def from_row(cls, row: dict[str, str | None]) -> Problem:
        """The problem that `as_row` kept."""
        return cls(Code(row["code"]), row["member"], row["expected"], row["found"], row["hint"])

    def as_warning(self) -> dict[str, str | None]:
        """The short form in which warnings are reported."""
        return {"member": self.member, "code": self.code.value, "hint": self.hint or HINTS[self.code]}

    def __str__(self) -> str:
        """One line for a terminal."""
        said = ", ".join(
            text
            for text in (
                f"expected {self.expected}" if self.expected else "",
                f"found {self.found}" if self.found else "",
            )
            if text
        )
        where = f"{self.member}: " if self.member else ""
        return f"{where}{self.code.value}{f' ({said})' if said else ''}. {self.hint or HINTS[self.code]}"


class WildScenesError(Exception):
    """Base of what this package raises on purpose; its text is meant for the person who reads it."""


class Refused(WildScenesError):
    """A member or an archive breaks a rule of submissions."""

    def __init__(self, problem: Problem) -> None:
        """Carry the problem to whoever reports it."""
        super().__init__(str(problem))
        self.problem = problem


class BenchmarkError(WildScenesError):
    """A benchmark definition contradicts itself, or something names what it does not define."""


class GroundTruthError(WildScenesError):
    """A data set cannot be packed, or a packed release is damaged or belongs to another benchmark."""
