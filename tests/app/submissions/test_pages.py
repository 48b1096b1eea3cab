"""Pages of submissions."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

import pytest
from starlette.testclient import TestClient

from app.submissions import evaluation, service
from app.submissions.disclosure import percent
from app.submissions.pages import shown_size
from app.submissions.sweeper import sweep
from tests.app.world import World


@pytest.fixture
def signed_in(small_world: World, client: TestClient) -> TestClient:
    """Ada's browser."""
    client.post("/sign-in", data={"token": small_world.token()})
    return client


def send(client: TestClient, data: bytes, **fields: str) -> UUID:
    form = {"track": "2d-standard", "method": "Forest", "labels": "benchmark", "visibility": "private", **fields}
    answer = client.post("/submit", data=form, files={"file": ("my.zip", data)})
    assert answer.status_code == 303, answer.text
    return UUID(answer.headers["location"].removeprefix("/submissions/"))


@pytest.mark.parametrize(
    ("size", "said"),
    [(None, "\N{EM DASH}"), (0, "0.0 kB"), (1234, "1.2 kB"), (999_999, "1000.0 kB"), (2_000_000_000, "2000.0 MB")],
)
def test_a_size_reads_in_kilobytes_or_megabytes(size: int | None, said: str) -> None:
    assert shown_size(size) == said


def test_a_visitor_is_asked_to_sign_in(client: TestClient) -> None:
    assert "/sign-in?next=/submit" in client.get("/submit").text
    assert client.get("/submissions").status_code == 401
    assert client.post("/submit", data={"track": "2d-standard"}).status_code == 401


def test_the_form_offers_every_track_and_every_encoding(small_world: World, signed_in: TestClient) -> None:
    page = signed_in.get("/submit?track=3d-val").text
    assert '<option value="3d-val" selected>' in page
    values = re.findall(r'<option value="([^"]+)"', page)
    benchmark = small_world.wired.benchmarks["wildscenes"]
    assert values == [*small_world.wired.tracks, *benchmark.encodings]


def test_a_submission_goes_from_the_form_over_its_progress_to_its_scores_and_the_board(
    small_world: World, signed_in: TestClient
) -> None:
    submission_id = send(signed_in, small_world.predictions("2d-standard"))
    here = f"/submissions/{submission_id}"
    page = signed_in.get(here).text
    assert "Waiting for a worker" in page
    assert f'data-live="/api/v1{here}"' in page
    assert f'action="{here}/publish"' not in page

    evaluation.run(small_world.wired, small_world.evaluation(submission_id).id)
    page, kept = signed_in.get(here).text, small_world.results(submission_id)
    assert f"<dt>mIoU, %</dt><dd>{percent(kept['miou'], 2)}</dd>" in page
    for one in kept["classes"].values():
        assert f'<td class="number">{percent(one["iou"], 1)}</td>' in page
    assert f'action="{here}/publish"' in page
    assert "data-live" not in page
    assert percent(kept["miou"], 2) in signed_in.get("/submissions").text

    assert signed_in.post(f"{here}/publish").headers["location"] == here
    assert f'action="{here}/publish"' not in signed_in.get(here).text
    assert f'href="http://testserver{here}"' in signed_in.get("/leaderboards/2d-standard").text


def test_a_rejected_submission_lists_what_has_to_change(small_world: World, signed_in: TestClient) -> None:
    submission_id = send(signed_in, b"<html>")
    evaluation.run(small_world.wired, small_world.evaluation(submission_id).id)
    page = signed_in.get(f"/submissions/{submission_id}").text
    assert "What has to change" in page
    assert '<code class="tag">not_a_zip</code>' in page


def test_a_failed_submission_says_that_the_fault_is_ours(small_world: World, signed_in: TestClient) -> None:
    submission_id = send(signed_in, small_world.predictions("2d-standard"))
    small_world.wired.storage.delete(small_world.submission(submission_id).upload_key or "")
    for _ in range(3):
        with pytest.raises(FileNotFoundError):
            evaluation.run(small_world.wired, small_world.evaluation(submission_id).id)
    sweep(small_world.wired)
    page = signed_in.get(f"/submissions/{submission_id}").text
    assert "Our fault: scoring failed, and the file is kept" in page
    assert (small_world.submission(submission_id).upload_key or "-") not in page


@pytest.mark.parametrize(
    ("change", "status", "said"),
    [
        ({"track": "4d"}, 422, "there is no track"),
        ({"method": ""}, 422, "names your method; it is empty"),
        ({"labels": "<b>"}, 422, "there is no label encoding"),
        ({"visibility": "secret"}, 422, "is &#39;private&#39; or &#39;public&#39;"),
    ],
)
def test_a_form_that_is_refused_comes_back_with_the_reason(
    signed_in: TestClient, change: dict[str, str], status: int, said: str
) -> None:
    form = {"track": "2d-standard", "method": "Forest", **change}
    answer = signed_in.post("/submit", data=form, files={"file": b"zip"})
    assert (answer.status_code, said in answer.text, "<b>" in answer.text) == (status, True, False)
    assert '<form class="fields" method="post" action="/submit"' in answer.text


def test_a_public_submission_is_shown_to_everybody_without_what_only_its_team_may_do(
    small_world: World, client: TestClient
) -> None:
    submission_id = small_world.scored(small_world.person(), method="<script>alert(1)</script>", public=True)
    page = client.get(f"/submissions/{submission_id}").text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "<script>alert" not in page
    assert "publish" not in page.lower().replace("published", "")
    service.hide(small_world.wired, submission_id)
    assert client.get(f"/submissions/{submission_id}").status_code == 404


def test_a_private_submission_is_not_found_by_others(
    small_world: World, client: TestClient, open_client: Callable[[World], TestClient]
) -> None:
    submission_id = small_world.scored(small_world.person("bob@example.org"))
    client.post("/sign-in", data={"token": small_world.token("eve@example.org")})
    for browser in (client, open_client(small_world)):
        assert browser.get(f"/submissions/{submission_id}").status_code == 404
    assert client.post(f"/submissions/{submission_id}/publish").status_code == 404


def test_practice_figures_read_alike_on_page_and_list(small_world: World, signed_in: TestClient) -> None:
    submission_id = send(signed_in, small_world.predictions("3d-val"), track="3d-val")
    evaluation.run(small_world.wired, small_world.evaluation(submission_id).id)
    kept = small_world.results(submission_id)
    page = signed_in.get(f"/submissions/{submission_id}").text
    assert f"<dt>Official mean, %</dt><dd>{percent(kept['miou_13'], 2)}</dd>" in page
    assert percent(kept["miou"], 2) in signed_in.get("/submissions").text


def test_an_upload_over_the_limit_is_refused_on_the_page(
    make_world: Callable[..., World],
    open_client: Callable[[World], TestClient],
    sqlite_url: str,
    tmp_path: Path,
) -> None:
    world = make_world(sqlite_url, max_upload_bytes=10)
    browser = open_client(world)
    browser.post("/sign-in", data={"token": world.token()})
    form = {"track": "2d-standard", "method": "Forest"}
    answer = browser.post("/submit", data=form, files={"file": b"z" * 11})
    assert (answer.status_code, "an upload has at most 10 bytes" in answer.text) == (413, True)
