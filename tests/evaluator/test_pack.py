"""A folder of predictions becomes a zip that the server accepts, or an error that names every problem."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from evaluator.benchmark import load
from evaluator.errors import BenchmarkError, WildScenesError
from evaluator.pack import Packed, PackError, pack

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

WILDSCENES = load()
IMAGES, CLOUDS = WILDSCENES.track("2d-standard"), WILDSCENES.track("3d-standard")
LABELS = np.array([[0, 1, 2], [14, 255, 9]], np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "predictions"
    made.mkdir()
    return made


def put(folder: Path, name: str, data: bytes | str) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())


def png(labels: NDArray[np.uint8], mode: str = "L") -> bytes:
    image = Image.fromarray(labels)
    if mode == "P":
        image.putpalette([v for c in WILDSCENES.classes for v in c.color])
    elif mode != "L":
        image = image.convert(mode)
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def npy(labels: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(labels), allow_pickle=True)
    return buffer.getvalue()


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def raw_png(*, depth: int, colour: int, interlace: int = 0) -> bytes:
    """A PNG of one black pixel with this header."""
    header = struct.pack(">IIBBBBB", 1, 1, depth, colour, 0, 0, interlace)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0\0")) + chunk(b"IEND", b"")


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {entry.filename: archive.read(entry) for entry in archive.infolist()}


def pixels(data: bytes) -> list[list[int]]:
    with Image.open(io.BytesIO(data)) as image:
        assert (image.format, image.mode) == ("PNG", "L")
        return np.array(image).tolist()


def problems(folder: Path, track: object = IMAGES, encoding: str = "benchmark") -> tuple[str, ...]:
    """What pack objects to; it must leave nothing behind."""
    before = sorted(folder.parent.rglob("*"))
    with pytest.raises(PackError) as caught:
        pack(folder, track, folder.parent / "out.zip", benchmark=WILDSCENES, encoding=encoding)  # type: ignore[arg-type]
    assert sorted(folder.parent.rglob("*")) == before
    return caught.value.problems


def test_label_files_are_copied_byte_for_byte_under_their_relative_names(folder: Path, tmp_path: Path) -> None:
    grey, palette = png(LABELS), png(np.minimum(LABELS, 14), "P")
    put(folder, "K-01/1-2.png", grey)
    put(folder, "sequences/V-01/1-3_pred.PNG", palette)
    assert pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES) == Packed(2, ())
    assert members(tmp_path / "out.zip") == {"K-01/1-2.png": grey, "sequences/V-01/1-3.png": palette}

    cloud = np.array([0, 14 | 7 << 16, 255], "<u4").tobytes()
    (tmp_path / "clouds").mkdir()
    put(tmp_path / "clouds", "1.2.LABEL", cloud)
    assert pack(tmp_path / "clouds", CLOUDS, tmp_path / "out.zip", benchmark=WILDSCENES) == Packed(1, ())
    assert members(tmp_path / "out.zip") == {"1.2.label": cloud}


@pytest.mark.parametrize(
    "data",
    [
        npy(LABELS),
        npy(LABELS.astype(np.int64)[None]),
        npy(LABELS.astype(">i2")[:, :, None]),
        npy(np.asfortranarray(LABELS)),
    ],
)
def test_an_array_becomes_a_greyscale_png_of_its_indices(folder: Path, tmp_path: Path, data: bytes) -> None:
    put(folder, "K-01/1-2_pred.npy", data)
    assert pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES) == Packed(1, ())
    ((name, made),) = members(tmp_path / "out.zip").items()
    assert (name, pixels(made)) == ("K-01/1-2.png", LABELS.tolist())


@pytest.mark.parametrize("text", ["0 1 2\n14 255 9\n", "\ufeff0\t1  2 \r\n14 255 9", "\n0 1 2\n14 255 9\n\n"])
def test_rows_of_text_become_a_greyscale_png(folder: Path, tmp_path: Path, text: str) -> None:
    put(folder, "1-2.txt", text)
    pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES)
    assert pixels(members(tmp_path / "out.zip")["1-2.png"]) == LABELS.tolist()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("1.2.npy", npy(np.array([0, 14, 255], np.uint8))),
        ("1.2.npy", npy(np.array([[0], [14], [255]], np.int32))),
        ("1.2.txt", "0\n14\n255\n"),
        ("1.2_pred.Txt", "0\r\n14\r\n255"),
    ],
)
def test_points_become_little_endian_32_bit_integers(
    folder: Path, tmp_path: Path, name: str, data: bytes | str
) -> None:
    put(folder, name, data)
    assert pack(folder, CLOUDS, tmp_path / "out.zip", benchmark=WILDSCENES) == Packed(1, ())
    assert members(tmp_path / "out.zip") == {"1.2.label": bytes([0, 0, 0, 0, 14, 0, 0, 0, 255, 0, 0, 0])}


def test_labels_stay_in_the_named_encoding(folder: Path, tmp_path: Path) -> None:
    put(folder, "1-2.npy", npy(np.array([[0, 18]], np.uint8)))
    pack(folder, IMAGES, tmp_path / "out.zip", encoding="raw19", benchmark=WILDSCENES)
    assert pixels(members(tmp_path / "out.zip")["1-2.png"]) == [[0, 18]]
    assert problems(folder) == ("1-2.npy: value 18 in 1 pixel; label encoding 'benchmark' lacks it",)


def test_other_files_are_named_and_hidden_ones_are_not(folder: Path, tmp_path: Path) -> None:
    put(folder, "1-2.png", png(LABELS))
    for name in (
        "b/README.md",
        "a.zip",
        "noext",
        ".DS_Store",
        "._1-2.png",
        "__MACOSX/1-2.png",
        "Thumbs.db",
        ".git/x.npy",
    ):
        put(folder, name, "x")
    (folder / "linked").symlink_to(tmp_path)
    assert pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES) == Packed(
        1, ("a.zip", "b/README.md", "linked", "noext")
    )


def test_the_same_labels_give_the_same_bytes_wherever_and_whenever_they_were_saved(tmp_path: Path) -> None:
    names = ["b/2-2.npy", "a/1-1.npy", "1-3.npy"]
    for folder, order in (("x", names), ("y", names[::-1])):
        for name in order:
            put(tmp_path / folder, name, npy(LABELS))
        pack(tmp_path / folder, IMAGES, tmp_path / f"{folder}.zip", benchmark=WILDSCENES)
    assert (tmp_path / "x.zip").read_bytes() == (tmp_path / "y.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        assert [(one.filename, one.date_time, one.compress_type) for one in archive.infolist()] == [
            (name, (1980, 1, 1, 0, 0, 0), zipfile.ZIP_DEFLATED) for name in ("1-3.png", "a/1-1.png", "b/2-2.png")
        ]


def test_progress_counts_up_to_all_files(folder: Path, tmp_path: Path) -> None:
    for name in ("1-1.npy", "1-2.npy", "README"):
        put(folder, name, npy(LABELS))
    seen: list[tuple[int, int]] = []
    pack(folder, IMAGES, tmp_path / "o.zip", benchmark=WILDSCENES, progress=lambda *at: seen.append(at))
    assert seen == [(1, 2), (2, 2)]


PAINTED = "looks painted; save the class indices as an 8-bit greyscale or palette PNG, not colours"
SAVE_INTEGERS = "save integers, whole numbers in floats are refused too: labels.astype(numpy.uint8)"
TWO_VALUES = "value -1 in 1 pixel, value 256 in 2 pixels; label encoding 'benchmark' lacks them"
MANY_VALUES = (
    "value 15 in 1 pixel, value 16 in 1 pixel, value 17 in 1 pixel and 2 other values; "
    "label encoding 'benchmark' lacks them"
)


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("f.png", png(LABELS, "RGB"), PAINTED),
        ("f.png", png(LABELS, "RGBA"), PAINTED),
        ("f.png", png(LABELS, "LA"), PAINTED),
        ("f.png", png(LABELS, "1"), PAINTED),
        ("f.png", raw_png(depth=4, colour=0), PAINTED),
        ("f.png", raw_png(depth=16, colour=0), PAINTED),
        ("f.png", raw_png(depth=8, colour=0, interlace=1), "is interlaced; save the PNG without interlacing"),
        ("f.png", b"GIF89a", "is not a PNG"),
        ("f.png", b"", "is not a PNG"),
        ("f.label", bytes(4), "the track takes images: give .png, .npy or .txt"),
        ("f.npy", npy(LABELS.astype(np.float32)), f"holds float32; {SAVE_INTEGERS}"),
        (
            "f.npy",
            npy(np.zeros((9, 4, 6), np.uint8)),
            "has shape (9, 4, 6), expected (H, W): one class index per pixel",
        ),
        ("f.npy", npy(np.zeros(6, np.uint8)), "has shape (6,), expected (H, W): one class index per pixel"),
        ("f.npy", npy(np.zeros((0, 6), np.uint8)), "has shape (0, 6), expected (H, W): one class index per pixel"),
        ("f.npy", npy([[-1, 256, 256, 3]]), TWO_VALUES),
        ("f.npy", npy([[15, 16, 17, 18, 254]]), MANY_VALUES),
        ("f.txt", "0 1\n2\n", "has rows of different lengths"),
        ("f.txt", "0 1.0\n", "is empty or holds something else than integers"),
        ("f.txt", " \n", "is empty or holds something else than integers"),
        ("f.txt", "15 3", "value 15 in 1 pixel; label encoding 'benchmark' lacks it"),
    ],
)
def test_an_image_file_that_cannot_be_a_prediction_is_refused(
    folder: Path, name: str, data: bytes | str, problem: str
) -> None:
    put(folder, f"K-01/{name}", data)
    assert problems(folder) == (f"K-01/{name}: {problem}",)


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("f.png", png(LABELS), "the track takes clouds: give .label, .npy or .txt"),
        ("f.label", bytes(5), "has 5 bytes; a .label has 4 bytes (little-endian uint32) per point"),
        ("f.label", b"", "has 0 bytes; a .label has 4 bytes (little-endian uint32) per point"),
        (
            "f.label",
            np.array([300, 300, 1, 15], "<u4").tobytes(),
            "value 15 in 1 point, value 300 in 2 points; label encoding 'benchmark' lacks them",
        ),
        ("f.npy", npy(LABELS), "has shape (2, 3), expected (N,): one class index per point"),
        ("f.npy", npy([True]), f"holds bool; {SAVE_INTEGERS}"),
        ("f.txt", "1\n2 3\n", "needs one integer per line"),
        ("f.txt", "1 2\n3 4\n", "needs one integer per line"),
        ("f.txt", "1\n\n2\n", "needs one integer per line"),
        ("f.txt", "-1\n0\n", "value -1 in 1 point; label encoding 'benchmark' lacks it"),
    ],
)
def test_a_cloud_file_that_cannot_be_a_prediction_is_refused(
    folder: Path, name: str, data: bytes | str, problem: str
) -> None:
    put(folder, name, data)
    assert problems(folder, CLOUDS) == (f"{name}: {problem}",)


@pytest.mark.parametrize(
    ("name", "data", "start"),
    [
        ("f.png", png(LABELS)[:50], "cannot be read as a PNG: "),
        ("f.npy", npy(np.array([[None]])), "cannot be read as an array: "),
        ("f.npy", b"", "cannot be read as an array: "),
        ("f.npy", npy(LABELS)[:-1], "cannot be read as an array: "),
        ("f.txt", b"\xff\xfe1", "cannot be read as integers: "),
        ("f.txt", "1-2", "cannot be read as integers: "),
        ("f.txt", "9" * 40, "cannot be read as integers: "),
    ],
)
def test_a_damaged_file_is_refused_with_the_reader_s_own_words(
    folder: Path, name: str, data: bytes | str, start: str
) -> None:
    put(folder, name, data)
    (problem,) = problems(folder)
    assert problem.startswith(f"{name}: {start}")


def test_several_arrays_under_the_name_of_one_are_refused(folder: Path) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, LABELS)
    put(folder, "f.npy", buffer.getvalue())
    assert problems(folder) == ("f.npy: holds several arrays; save one array per file with numpy.save",)


def test_two_files_of_one_frame_are_refused(folder: Path) -> None:
    for name in ("a/1-2.npy", "a/1-2_pred.npy", "b/1-2.npy"):
        put(folder, name, npy(LABELS))
    assert problems(folder) == ("a/1-2_pred.npy: becomes a/1-2.png, as a/1-2.npy does; keep one of them",)


def test_all_problems_are_reported_at_once_and_twenty_are_listed(folder: Path) -> None:
    put(folder, "good.png", png(LABELS))
    for number in range(23):
        put(folder, f"{number:02}.txt", "99")
    found = problems(folder)
    assert found == tuple(f"{n:02}.txt: value 99 in 1 pixel; label encoding 'benchmark' lacks it" for n in range(23))
    error = PackError(*found)
    assert str(error).splitlines() == [*found[:20], "and 3 more"]
    assert isinstance(error, WildScenesError)


def test_more_files_than_a_submission_may_hold_are_refused(folder: Path, tmp_path: Path) -> None:
    small = WILDSCENES.model_copy(update={"limits": WILDSCENES.limits.model_copy(update={"max_members": 1})})
    for name in ("1-1.npy", "1-2.npy"):
        put(folder, name, npy(LABELS))
    with pytest.raises(PackError, match=r"^2 files, at most 1 are accepted; pack the frames of one track only$"):
        pack(folder, IMAGES, tmp_path / "out.zip", benchmark=small)


def test_a_folder_without_predictions_and_a_missing_folder_are_refused(folder: Path) -> None:
    put(folder, "README", "x")
    assert problems(folder) == (f"{folder} holds no predictions: files that end in .png, .label, .npy, .txt",)
    assert problems(folder / "none") == (f"{folder / 'none'} is not a folder",)


def test_an_unknown_encoding_is_refused_before_anything_is_read(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(
        BenchmarkError, match=r"^unknown label encoding 'mine'; there are: benchmark, raw19, mmdet3d13$"
    ):
        pack(folder, IMAGES, tmp_path / "out.zip", encoding="mine", benchmark=WILDSCENES)


def test_a_failure_leaves_the_earlier_zip_as_it_was(folder: Path, tmp_path: Path) -> None:
    put(folder, "1-1.npy", npy(LABELS))
    pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES)
    before = (tmp_path / "out.zip").read_bytes()
    put(folder, "1-2.txt", "99")
    assert len(problems(folder)) == 1
    assert (tmp_path / "out.zip").read_bytes() == before


def test_an_interrupted_run_leaves_nothing(folder: Path, tmp_path: Path) -> None:
    put(folder, "1-1.npy", npy(LABELS))

    def interrupt(_done: int, _of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pack(folder, IMAGES, tmp_path / "out.zip", benchmark=WILDSCENES, progress=interrupt)
    assert sorted(tmp_path.iterdir()) == [folder]
