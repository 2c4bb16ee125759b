"""A contest by link: a drive, its score, and the drive of a link as a ghost."""

import re

import numpy as np
import pytest

from teleop_drake import WritePage

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.slow]

PUSH = 0.2
"""The time of the first push, s: the last command that is 0 is one picture earlier."""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "drive.html"
    WritePage("one_dof", path, has_hand=True)
    return path


@pytest.fixture(scope="module")
def first(look, page):
    return look(page, "contest.js")


def test_before_the_first_push_there_are_no_curves(first):
    title = ": push the tool to the bone, and let it rest there, two controllers, "
    assert first["before"] == {"curves": False, "title": title + "0.1 s late"}


def test_the_score_is_force_times_time(first):
    metrics = first["metrics"]
    time = metrics["collision.time"] + metrics["collision.rest_time"] - PUSH
    score = metrics["collision.peak_force"] * time
    assert float(re.search(r"score ([\d.]+) N s", first["score"])[1]) == pytest.approx(
        score, abs=0.006
    )
    assert "largest force times the time from push to rest" in first["score"]


def test_whoever_opens_the_link_sees_the_drive_as_a_ghost(look, page, first):
    seen = look(page, "contest.js", link=f"#{first['link']}")
    np.testing.assert_allclose(seen["hand"], first["hand"], atol=1e-12)
    assert seen["metrics"] == pytest.approx(first["metrics"], rel=1e-6)
    assert re.fullmatch(
        r"Beat [\d.]+ N, [\d.]+ s \([\d.]+ N s\), 0.1 s late, gentle hand, with "
        r"adaptive backstepping. Its drive is pale.",
        seen["challenge"],
    )
    assert seen["ghosts"] == 1 and seen["pale"] >= 3
    assert len(first["link"]) < 400


def test_a_score_that_does_not_come_out_is_told(look, page, first):
    link = re.sub(r"score=[\d.]+", "score=0.001", first["link"])
    assert look(page, "contest.js", link=f"#{link}")["challenge"].startswith(
        "The link claims 0.001 N s, but its hand gives "
    )
    broken = re.sub(r"hand=.*", "hand=AAA", first["link"])
    seen = look(page, "contest.js", link=f"#{broken}")
    assert "hand: must be a whole one" in seen["status"]
