"""The local commands: what they print, what they write, and the status they end with."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from evaluator import SCORING_VERSION, __version__
from evaluator.benchmark import Benchmark
from evaluator.cli import main
from evaluator.errors import HINTS, Code, Problem
from evaluator.report import results, table

if TYPE_CHECKING:
    from tests.evaluator.conftest import Frames, Make, Planted

FOREST = str(Path(__file__).with_name("forest.toml"))
RESULT = [
    *("benchmark", "track", "evaluator", "scoring", "groundtruth", "frames", "miou", "accuracy"),
    *("mean_accuracy", "fw_iou", "classes", "confusion"),
]


def run(*args: object) -> tuple[int, str, str]:
    """Status, standard output and standard error of a command."""
    done = CliRunner().invoke(main, [str(arg) for arg in args], prog_name="wildscenes")
    return done.exit_code, done.stdout, done.stderr


def lines(*said: str) -> str:
    return "".join(f"{line}\n" for line in said)


@pytest.fixture
def perfect(demo: Planted, make: type[Make], tmp_path: Path) -> Callable[..., Path]:
    def archive(track_id: str) -> Path:
        return make.zip(tmp_path / f"{track_id}.zip", demo.flat(track_id))

    return archive


@pytest.fixture
def broken(make: type[Make], tmp_path: Path) -> Path:
    """A submission to the forest's photos: one frame of another size, one missing."""
    return make.zip(tmp_path / "broken.zip", {"3-000000001.png": make.png([[0]]), "README": b"hello"})


PROBLEMS = [
    Problem(Code.MISSING_FRAME, "South/4-000000001.png", "a member of this name", "none"),
    Problem(Code.WRONG_SIZE, "3-000000001.png", "4x2 (width x height)", "1x1"),
]
REFUSAL = {
    "valid": False,
    "problems": [one.as_json() for one in PROBLEMS],
    "problems_total": 2,
    "warnings": [{"member": "README", "code": "unknown_member", "hint": HINTS[Code.UNKNOWN_MEMBER]}],
    "warnings_total": 1,
}
SAID = f"""\
1 warnings:
README: unknown_member. {HINTS[Code.UNKNOWN_MEMBER]}
2 problems:
South/4-000000001.png: missing_frame (expected a member of this name, found none). {HINTS[Code.MISSING_FRAME]}
3-000000001.png: wrong_size (expected 4x2 (width x height), found 1x1). {HINTS[Code.WRONG_SIZE]}
"""


@pytest.mark.parametrize("track_id", ["2d-standard", "3d-standard"])
def test_evaluate_prints_the_table_and_writes_what_it_says_as_json(
    demo: Planted, perfect: Callable[..., Path], tmp_path: Path, track_id: str
) -> None:
    release, out = demo.truth.folder, tmp_path / "out.json"
    done = run("evaluate", perfect(track_id), "--track", track_id, "--groundtruth", release, "--json", out)
    said = json.loads(out.read_text("utf-8"))
    keys = RESULT if track_id == "2d-standard" else [*RESULT[:7], "miou_13", *RESULT[7:]]
    assert list(said) == keys
    assert all(list(one) == ["iou", "precision", "recall", "f1"] for one in said["classes"].values())
    assert list(said.values())[:7] == ["wildscenes", track_id, __version__, SCORING_VERSION, demo.truth.digest, 10, 1.0]
    assert done == (0, table(said) + "\n", "")


def test_evaluate_writes_a_matrix_a_frame(demo: Planted, perfect: Callable[..., Path], tmp_path: Path) -> None:
    archive, release, out = perfect("3d-standard"), demo.truth.folder, tmp_path / "frames.npz"
    done = run("evaluate", archive, "--track", "3d-standard", "--groundtruth", release, "--per-frame", out)
    assert done[0] == 0
    whole = demo.score(archive, "3d-standard")
    with np.load(out) as written:
        assert list(written) == ["frames", "confusion"]
        assert (written["frames"].shape, written["confusion"].shape) == ((10,), (10, 15, 16))
        assert written["confusion"].dtype == np.int64
        assert tuple(written["frames"].tolist()) == whole.frames
        np.testing.assert_array_equal(written["confusion"], whole.confusion)


def test_evaluate_says_the_same_with_any_number_of_jobs(demo: Planted, perfect: Callable[..., Path]) -> None:
    args = ["evaluate", perfect("2d-standard"), "--track", "2d-standard", "--groundtruth", demo.truth.folder]
    assert run(*args, "--jobs", 1) == run(*args, "--jobs", 7)


def test_evaluate_takes_another_encoding_and_another_benchmark(
    small: Planted, make: type[Make], tmp_path: Path
) -> None:
    in_ids = np.array([1, 3, 4] + [0] * 253, np.uint8)
    archive = make.zip(tmp_path / "ids.zip", small.flat("photo-whole", lambda labels: in_ids[labels]))
    args = ["evaluate", archive, "--track", "photo-whole", "--groundtruth", small.truth.folder, "--benchmark", FOREST]
    total = small.score(archive, "photo-whole", "ids").confusion.sum(axis=0)
    said = results(total, small.benchmark.track("photo-whole"), small.benchmark, digest="", frames=2)
    assert said["miou"] == 1
    assert run(*args, "--labels", "ids") == (0, table(said) + "\n", "")
    assert run(*args)[0] == 1


def test_evaluate_refuses_with_status_1_and_says_why(small: Planted, broken: Path, tmp_path: Path) -> None:
    release, out = small.truth.folder, tmp_path / "out.json"
    done = run(
        *("evaluate", broken, "--track", "photo-whole", "--groundtruth", release),
        *("--json", out, "--per-frame", tmp_path / "none.npz", "--benchmark", FOREST),
    )
    assert done == (1, "", SAID)
    assert json.dumps(json.loads(out.read_text("utf-8"))) == json.dumps(REFUSAL)
    assert not (tmp_path / "none.npz").exists()


@pytest.mark.parametrize("source", ["--groundtruth", "--facts"])
def test_validate_checks_against_a_release_or_its_facts(
    small: Planted, make: type[Make], broken: Path, tmp_path: Path, source: str
) -> None:
    known = small.truth.folder if source == "--groundtruth" else small.truth.folder / "facts.json"
    options = ["--track", "photo-whole", source, known, "--benchmark", FOREST]
    fine = make.zip(tmp_path / "fine.zip", small.flat("photo-whole"))
    assert run("validate", fine, *options) == (0, "valid for photo-whole\n", "")
    assert run("validate", broken, *options) == (1, "", SAID)
    status, said, errors = run("validate", broken, *options, "--json")
    assert (status, json.dumps(json.loads(said)), errors) == (1, json.dumps(REFUSAL), "")
    status, said, errors = run("validate", fine, *options, "--json")
    assert (status, list(json.loads(said)), errors) == (0, list(REFUSAL), "")


def test_validate_without_either_says_what_it_could_not_check(perfect: Callable[..., Path]) -> None:
    note = f"1 warnings:\nchecked_without_facts. {HINTS[Code.CHECKED_WITHOUT_FACTS]}\n"
    done = run("validate", perfect("3d-val"), "--track", "3d-val")
    assert done == (0, "valid for 3d-val\n", note)


def test_validate_takes_a_release_or_its_facts_but_not_both(small: Planted, broken: Path) -> None:
    facts = small.truth.folder / "facts.json"
    done = run("validate", broken, "--track", "2d-val", "--groundtruth", small.truth.folder, "--facts", facts)
    assert (done[0], done[2].splitlines()[-1]) == (2, "Error: --groundtruth and --facts exclude each other")


def test_groundtruth_build_prints_its_counts_and_digest(small: Planted, tmp_path: Path) -> None:
    out = tmp_path / "release"
    options = ["--data", small.data, "--splits", small.splits, "--out", out, "--benchmark", FOREST]
    assert run("groundtruth", "build", *options) == (
        0,
        lines(
            "photo: 3 frames",
            "  leaf                          10",
            "  soil                           6",
            "  stone                          4",
            "  unlabelled                     4",
            "scan: 2 frames",
            "  leaf                           4",
            "  soil                           4",
            "  stone                          2",
            "  unlabelled                     1",
            f"digest {small.truth.digest}",
            f"public facts, to give away: {out / 'facts.json'}",
        ),
        "",
    )
    assert json.loads((out / "facts.json").read_text("utf-8"))["open"] is False
    assert run("groundtruth", "build", *options) == (2, "", f"Error: {out} is not empty\n")


def test_groundtruth_build_takes_open_and_allow_absent(
    forest: Benchmark, forest_frames: Frames, planting: Callable[..., Path], tmp_path: Path
) -> None:
    forest_frames["scan", "test", "North", "3-000000001"] = [2]
    forest_frames["scan", "test", "South", "4-000000001"] = [0]
    data, out = planting(tmp_path / "data", forest, forest_frames), tmp_path / "release"
    options = ["--data", data, "--splits", data / "splits", "--out", out, "--benchmark", FOREST]
    status, _, errors = run("groundtruth", "build", *options)
    assert (status, errors.endswith("trial): scan-whole: soil\n")) == (2, True)
    assert run("groundtruth", "build", *options, "--open", "--allow-absent")[0] == 0
    assert json.loads((out / "facts.json").read_text("utf-8"))["open"] is True


def test_groundtruth_verify_ends_with_0_when_intact_and_1_when_not(
    small: Planted, forest: Benchmark, planting: Callable[..., Path], packing: Callable[..., Planted], tmp_path: Path
) -> None:
    said = f"5 frames, all intact; digest {small.truth.digest}\n"
    assert run("groundtruth", "verify", small.truth.folder, "--benchmark", FOREST) == (0, said, "")
    frames = {("scan", "test", "North", "1-000000001"): [0, 1]}
    packed = packing(forest, planting(tmp_path / "data", forest, frames), tmp_path / "release")
    (packed.truth.folder / "scan.runs").write_bytes(b"\x00\x02" + b"\x01\0\0\0" * 2)
    done = run("groundtruth", "verify", packed.truth.folder, "--benchmark", FOREST)
    assert done == (1, "scan frame 1-000000001 is damaged\n", "")


def test_tracks_lists_what_each_is_trained_on_and_scores() -> None:
    assert run("tracks", "--benchmark", FOREST) == (
        0,
        lines(
            "photo-whole  Photo Whole, 2 frames",
            "    trained on anything; tested on North, South",
            "    scores leaf, soil, stone",
            "photo-practice  Photo Practice",
            "    trained on leaves; tested on North",
            "    scores leaf, soil, stone",
            "scan-whole  Scan Whole",
            "    trained on anything; tested on North, South",
            "    scores leaf, soil",
        ),
        "",
    )
    assert run("tracks")[1].count(" frames\n    trained on ") == 12


def test_pack_makes_what_evaluate_scores(small: Planted, tmp_path: Path) -> None:
    folder, out = tmp_path / "predictions", tmp_path / "packed.zip"
    folder.mkdir()
    for (_, frame), labels in small.answers("photo-whole").items():
        np.save(folder / f"{frame}.npy", labels)
    (folder / "notes.md").write_text("hello", "utf-8")
    done = run("pack", folder, "--track", "photo-whole", "--out", out, "--benchmark", FOREST)
    assert done == (0, f"{out}: 2 members\n", "skipped notes.md\n")
    assert small.score(out, "photo-whole").valid


def test_demo_data_is_what_groundtruth_build_takes(tmp_path: Path) -> None:
    data, out = tmp_path / "data", tmp_path / "release"
    done = run("demo-data", data, "--frames", 1, "--size", "32x24", "--points", 200)
    assert done == (0, f"{data}: synthetic labels; its split files are in {data / 'splits'}\n", "")
    assert run("groundtruth", "build", "--data", data, "--splits", data / "splits", "--out", out)[0] == 0
    assert run("demo-data", data) == (2, "", f"Error: {data} is not empty\n")


def test_demo_data_of_a_benchmark_without_its_classes_is_refused(tmp_path: Path) -> None:
    status, _, errors = run("demo-data", tmp_path / "data", "--benchmark", FOREST)
    assert (status, errors.startswith("Error: the demo draws classes that forest does not have: ")) == (2, True)


@pytest.mark.parametrize("size", ["32", "32x", "x24", "axb", "-1x24"])
def test_demo_data_wants_a_size_of_two_numbers(tmp_path: Path, size: str) -> None:
    status, _, errors = run("demo-data", tmp_path / "data", "--size", size)
    assert (status, "expected WxH, for example 252x189" in errors) == (2, True)


@pytest.mark.parametrize(
    ("args", "last"),
    [
        (["--track", "2d"], "Error: unknown track '2d'; there are: photo-whole, photo-practice, scan-whole\n"),
        (["--track", "photo-whole", "--labels", "rgb"], "Error: unknown label encoding 'rgb'; there are: benchmark, "),
        ([], "Error: Missing option '--track'."),
        (["--track", "photo-whole", "--facts", FOREST], "no file of facts"),
        (["--track", "photo-whole", "--colour"], "Error: No such option"),
    ],
)
def test_a_wrong_call_ends_with_status_2_and_a_sentence(broken: Path, args: list[str], last: str) -> None:
    status, said, errors = run("validate", broken, "--benchmark", FOREST, *args)
    assert (status, said) == (2, "")
    assert last in errors


def test_a_file_that_is_no_definition_is_a_wrong_call(broken: Path) -> None:
    status, _, errors = run("validate", broken, "--track", "2d-val", "--benchmark", broken)
    assert (status, "cannot read the benchmark definition" in errors) == (2, True)


@pytest.mark.parametrize(
    "command", ["tracks", "validate", "evaluate", "pack", "demo-data", "groundtruth build", "groundtruth verify"]
)
def test_every_local_command_takes_another_benchmark(command: str) -> None:
    assert "--benchmark FILE" in run(*command.split(), "--help")[1]


def test_the_version_is_that_of_the_package() -> None:
    assert run("--version") == (0, f"wildscenes, version {__version__}\n", "")


def test_a_command_whose_part_is_not_installed_says_what_to_install(tmp_path: Path) -> None:
    part = tmp_path / "paint-1.0.dist-info"
    part.mkdir()
    (part / "METADATA").write_text("Metadata-Version: 2.1\nName: paint\nVersion: 1.0\n", "utf-8")
    (part / "entry_points.txt").write_text("[wildscenes.commands]\npaint = no_such_library.cli:main\n", "utf-8")
    command = [sys.executable, "-W", "error", "-m", "evaluator.cli", "paint"]
    env = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, check=False, capture_output=True, timeout=60, env=env)
    said = b"Error: 'paint' needs no_such_library: pip install 'wildscenes[server]'\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", said)
