"""A folder of predictions as a zip that the server accepts."""

from __future__ import annotations

import io
import os
import re
import zipfile
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from evaluator.benchmark import INVALID, UNLABELLED
from evaluator.errors import WildScenesError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from evaluator.benchmark import Benchmark, Track

READABLE = (".png", ".label", ".npy", ".txt")
"""Extensions, in lower case, of the files that are taken."""

_LISTED = 20
LISTED = 3
"""Values that an error lists."""

_UNITS = {"image": "pixel", "cloud": "point"}
_IHDR_END = 29
_PNG_START = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
_LONG_AGO = (1980, 1, 1, 0, 0, 0)


class PackError(WildScenesError):
    """A folder of predictions cannot become a submission; nothing was written.

    Attributes:
        problems: every problem as one line, in the order of the files; the text of the error lists the first 20.
    """

    def __init__(self, *problems: str) -> None:
        """Carry every problem and list the first ones."""
        self.problems = problems
        lines = list(problems[:_LISTED])
        if len(problems) > _LISTED:
            lines.append(f"and {len(problems) - _LISTED} more")
        super().__init__("\n".join(lines))


@dataclass(frozen=True)
class Packed:
    """What became of a folder.

    Attributes:
        members: the number of label files in the zip.
        skipped: other files, relative to the folder, in order; hidden files are not named.
    """

    members: int
    skipped: tuple[str, ...]


def pack(  # noqa: PLR0913 - three things and three choices, the choices by name
    folder: Path,
    track: Track,
    out: Path,
    *,
    encoding: str = "benchmark",
    benchmark: Benchmark,
    progress: Callable[[int, int], None] | None = None,
) -> Packed:
    """Write the label files below a folder as one zip, each under its relative name with the track's extension.

    A `.png` or `.label` is copied byte for byte. A `.npy` or `.txt` of integers becomes one: images have shape (H, W),
    (1, H, W) or (H, W, 1), clouds (N,) or (N, 1); text has a row of an image, or a point, per line. `_pred` at the end
    of a name is dropped. Values stay in the named encoding. The same folder gives the same bytes.

    Args:
        folder: searched with its subfolders; linked folders are not followed but named in `skipped`.
        track: decides between images and clouds.
        out: the zip to write or replace, in a folder that exists.
        encoding: the label encoding of every file.
        benchmark: the definition that has the encoding.
        progress: called with the files done and all files, after each file.

    Raises:
        PackError: with every problem of every file; `out` is as it was.
        BenchmarkError: there is no such encoding.
        OSError: a file cannot be read or `out` cannot be written.
    """
    valid = benchmark.columns(encoding) != INVALID
    members, skipped, problems = _find(folder, track, benchmark.limits.max_members)
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        with zipfile.ZipFile(part, "w") as archive:
            for done, (member, path) in enumerate(members, 1):
                try:
                    data = _read(path, track.modality.kind, valid, encoding)
                except PackError as error:
                    problems.append(f"{path.relative_to(folder).as_posix()}: {error}")
                else:
                    if not problems:
                        add_member(archive, member, data)
                if progress:
                    progress(done, len(members))
        if problems:
            raise PackError(*problems)
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)
    return Packed(len(members), tuple(skipped))


def encode_labels(labels: NDArray[np.uint8], kind: str) -> bytes:
    """Class indices as the bytes of a label file.

    Args:
        labels: shape (H, W) for an image, (N,) for a cloud.
        kind: "image" for an 8-bit greyscale PNG, "cloud" for little-endian uint32.
    """
    if kind == "cloud":
        return labels.astype("<u4").tobytes()
    buffer = io.BytesIO()
    Image.fromarray(labels).save(buffer, "PNG")
    return buffer.getvalue()


def add_member(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Add a deflated member that has no date of its own, so that the same labels give the same archive."""
    entry = zipfile.ZipInfo(name, _LONG_AGO)
    entry.create_system, entry.external_attr = 3, 0o100644 << 16  # the same on every operating system
    archive.writestr(entry, data, zipfile.ZIP_DEFLATED)


def _find(folder: Path, track: Track, most: int) -> tuple[list[tuple[str, Path]], list[str], list[str]]:
    """Member names with their files, skipped files, and problems with names."""
    if not folder.is_dir():
        raise PackError(f"{folder} is not a folder")
    claimed: dict[str, Path] = {}
    skipped, problems = [], []
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if any(part.startswith(".") or part in {"__MACOSX", "Thumbs.db"} for part in relative.parts):
            continue
        if path.is_dir() and not path.is_symlink():
            continue
        if not path.is_file() or path.suffix.lower() not in READABLE:
            skipped.append(relative.as_posix())
            continue
        stem = path.stem.removesuffix("_pred") or path.stem
        member = relative.with_name(stem + track.modality.suffix).as_posix()
        if member in claimed:
            first = claimed[member].relative_to(folder).as_posix()
            problems.append(f"{relative.as_posix()}: becomes {member}, as {first} does; keep one of them")
        else:
            claimed[member] = path
    if not claimed:
        raise PackError(f"{folder} holds no predictions: files that end in {', '.join(READABLE)}")
    if len(claimed) > most:
        problems.append(f"{len(claimed)} files, at most {most} are accepted; pack the frames of one track only")
    return list(claimed.items()), skipped, problems


def _read(path: Path, kind: str, valid: NDArray[np.bool_], encoding: str) -> bytes:
    """A file as the bytes of a member; its values are checked against the encoding."""
    suffix, data = path.suffix.lower(), path.read_bytes()
    if suffix == (".label" if kind == "image" else ".png"):
        wanted = ".png, .npy or .txt" if kind == "image" else ".label, .npy or .txt"
        raise PackError(f"the track takes {kind}s: give {wanted}")
    if suffix in {".png", ".label"}:
        _check_values(_from_png(data) if suffix == ".png" else _from_label(data), valid, encoding)
        return data
    labels = _from_npy(data, kind) if suffix == ".npy" else _from_txt(data, kind)
    _check_values(labels, valid, encoding)
    return encode_labels(labels.astype(np.uint8), kind)


def _from_png(data: bytes) -> NDArray[np.uint8]:
    if len(data) < _IHDR_END or not data.startswith(_PNG_START):
        raise PackError("is not a PNG")
    depth, colour, interlace = data[24], data[25], data[28]
    # Pillow stretches greyscale of 1, 2 and 4 bits to 0..255, so only the header tells the indices apart.
    if colour != _PALETTE and (colour, depth) != (_GREY, 8):
        raise PackError("looks painted; save the class indices as an 8-bit greyscale or palette PNG, not colours")
    if interlace:
        raise PackError("is interlaced; save the PNG without interlacing")
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            return np.asarray(image, np.uint8)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PackError(f"cannot be read as a PNG: {error}") from error


def _from_label(data: bytes) -> NDArray[np.uint16]:
    if not data or len(data) % 4:
        raise PackError(f"has {len(data)} bytes; a .label has 4 bytes (little-endian uint32) per point")
    return np.frombuffer(data, "<u2")[::2]  # class in the low half of each point


def _from_npy(data: bytes, kind: str) -> NDArray[Any]:
    try:
        labels = np.load(io.BytesIO(data), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise PackError(f"cannot be read as an array: {error}") from error
    if not isinstance(labels, np.ndarray):
        raise PackError("holds several arrays; save one array per file with numpy.save")
    if labels.dtype.kind not in "iu":
        raise PackError(
            f"holds {labels.dtype}; save integers, whole numbers in floats are refused too: labels.astype(numpy.uint8)"
        )
    shape = labels.shape
    if kind == "image" and len(shape) == 3 and 1 in (shape[0], shape[2]):
        labels = labels[0] if shape[0] == 1 else labels[:, :, 0]
    elif kind == "cloud" and len(shape) == 2 and shape[1] == 1:
        labels = labels[:, 0]
    if labels.ndim != (2 if kind == "image" else 1) or not labels.size:
        expected = "(H, W)" if kind == "image" else "(N,)"
        raise PackError(f"has shape {shape}, expected {expected}: one class index per {_UNITS[kind]}")
    return np.asarray(labels)


def _from_txt(data: bytes, kind: str) -> NDArray[np.int64]:
    try:
        text = data.decode("utf-8-sig").strip()
        if not re.fullmatch(r"[-\d\s]+", text, re.ASCII):
            raise PackError("is empty or holds something else than integers")
        rows = [[int(word) for word in line.split()] for line in text.splitlines()]
        if len({len(row) for row in rows}) > 1 or (kind == "cloud" and len(rows[0]) != 1):
            raise PackError("needs one integer per line" if kind == "cloud" else "has rows of different lengths")
        labels = np.array(rows, np.int64)
    except (ValueError, OverflowError) as error:
        raise PackError(f"cannot be read as integers: {error}") from error
    return labels if kind == "image" else labels[:, 0]


def _check_values(labels: NDArray[Any], valid: NDArray[np.bool_], encoding: str) -> None:
    """Refuse values that the encoding lacks."""
    if labels.min() >= 0 and labels.max() <= UNLABELLED:
        counts = np.bincount(labels.astype(np.uint8).ravel(), minlength=256)
        wrong = [(value, int(counts[value])) for value in np.flatnonzero((counts > 0) & ~valid).tolist()]
    else:
        found = zip(*(one.tolist() for one in np.unique(labels, return_counts=True)), strict=True)
        wrong = [(value, count) for value, count in found if not 0 <= value <= UNLABELLED or not valid[value]]
    if wrong:
        unit = _UNITS["cloud" if labels.ndim == 1 else "image"]
        listed = ", ".join(f"value {value} in {count} {unit}{'s' * (count > 1)}" for value, count in wrong[:LISTED])
        more = f" and {len(wrong) - LISTED} other values" if len(wrong) > LISTED else ""
        raise PackError(f"{listed}{more}; label encoding {encoding!r} lacks {'it' if len(wrong) == 1 else 'them'}")
