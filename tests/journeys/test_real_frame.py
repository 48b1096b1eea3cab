"""A real annotated frame of another data set, with its own benchmark definition, through the whole service."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from evaluator.benchmark import load
from evaluator.build import build
from evaluator.pack import encode_labels

if TYPE_CHECKING:
    from tests.journeys.conftest import Serve, Server

ROOT = Path(__file__).resolve().parents[2]
DEFINITION = ROOT / "tests" / "evaluator" / "rellis3d.toml"
SOURCE = ROOT.parent / "shared" / "real" / "rellis3d"
FILES = {"2d": "frame000104-1581624663_149.png", "3d": "000104.label"}
SHIFTS: dict[str, dict[str, tuple[int, ...]]] = {
    "2d": {"slightly": (3, 5), "far": (40, 90)},
    "3d": {"slightly": (25,), "far": (900,)},
}

pytestmark = pytest.mark.skipif(not SOURCE.is_dir(), reason=f"the real frame is not here: no folder {SOURCE}")


@pytest.fixture(scope="module")
def truths() -> dict[str, NDArray[np.int64]]:
    """The frame's labels in RELLIS-3D's own ids, image and cloud."""
    with Image.open(SOURCE / FILES["2d"]) as image:
        return {"2d": np.array(image, np.int64), "3d": np.fromfile(SOURCE / FILES["3d"], "<u4").astype(np.int64)}


@pytest.fixture(scope="module")
def server(serve: Serve, tmp_path_factory: pytest.TempPathFactory) -> Server:
    folder = tmp_path_factory.mktemp("rellis3d")
    (folder / "00004").mkdir()
    for modality_id, modality in load(DEFINITION).modalities.items():
        shutil.copy(SOURCE / FILES[modality_id], folder / "00004")
        split = folder / "splits" / modality.splits / "test.csv"
        split.parent.mkdir(parents=True)
        split.write_text(f"id,label_path\n{Path(FILES[modality_id]).stem},00004/{FILES[modality_id]}\n", "utf-8")
    build(folder, folder / "splits", folder / "release", load(DEFINITION), allow_absent=True)
    return serve("--benchmark", DEFINITION, "--groundtruth", folder / "release")


def figures(true: NDArray[np.int64], predicted: NDArray[np.int64], ids: dict[str, int]) -> dict[str, Any]:
    """IoU of each class and their mean in plain numpy, in as many digits as a hidden release shows."""
    counted, ious = true != 0, {}
    for name, index in ids.items():
        here, there = (true == index) & counted, (predicted == index) & counted
        union = np.count_nonzero(here | there)
        ious[name] = np.count_nonzero(here & there) / union if union else None
    mean = np.mean([iou for iou in ious.values() if iou is not None])
    classes = {name: None if iou is None else round(iou, 3) for name, iou in ious.items()}
    return {"miou": round(float(mean), 4), "classes": classes}


@pytest.mark.parametrize("shift", ["slightly", "far"])
@pytest.mark.parametrize("modality", ["2d", "3d"])
def test_shifted_labels_of_a_real_frame_score_as_plain_numpy_says(
    server: Server, truths: dict[str, NDArray[np.int64]], tmp_path: Path, modality: str, shift: str
) -> None:
    benchmark, true = load(DEFINITION), truths[modality]
    predicted = np.roll(true, SHIFTS[modality][shift], axis=tuple(range(true.ndim)))
    archive, track = tmp_path / "shifted.zip", f"rellis3d-{modality}"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        kind = benchmark.modalities[modality].kind
        file.writestr(FILES[modality], encode_labels(predicted.astype(np.uint8), kind))

    token = server.token(f"{modality}-{shift}")
    said = server.settled(
        server.send(archive, token, track=track, method=shift, labels="ids", visibility="public"), token
    )
    assert (said["state"], said["problems"]) == ("scored", [])
    values = benchmark.encodings["ids"].values
    expected = figures(true, predicted, {name: values.index(name) for name in benchmark.names})
    assert said["scores"] == expected
    assert {name for name, iou in expected["classes"].items() if iou is not None} == {
        values[index] for index in np.unique(true) if index
    }
    rows = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
    assert [(row["miou"], row["classes"]) for row in rows if row["method"] == shift] == [
        (expected["miou"], expected["classes"])
    ]
