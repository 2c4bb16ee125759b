"""The picture of the task, and the scopes: what stays in place, and what has a name."""

import re

import pytest

from teleop_drake.study.page.page import WritePage

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.slow]


@pytest.fixture(scope="module")
def seen(look, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "arm.html"
    WritePage("two_dof_combined", page)
    return look(page, "picture.js")


def test_a_slider_changes_neither_the_frame_nor_units_nor_widths(seen):
    before = seen["before"]
    after = seen["after"]
    assert before["bone"] == after["bone"]
    assert before["widths"] == after["widths"] and min(before["widths"]) > 40
    shared = set(before["units"]) & set(after["units"])
    assert len(shared) == len(before["units"]) >= 6
    assert before["heads"] != after["heads"]


def test_an_arrow_is_the_force_on_the_tool(seen):
    """It points away from the bone, at +x, and its length is that of the force."""
    scales = []
    for instant in seen["arrows"]:
        forces = [force for force in instant["forces"] if force > 1e-3]
        assert len(instant["arrows"]) == len(forces)
        for (length, transform), force in zip(instant["arrows"], forces, strict=True):
            turn = float(re.search(r"rotate\((\S+)\)", transform)[1])
            assert abs(turn) == pytest.approx(180, abs=1)
            scales.append(length / force)
    assert len(scales) >= 2
    # The coordinates are written with all digits; forces along y are small.
    assert scales == pytest.approx([scales[0]] * len(scales), rel=1e-2)


def test_events_are_named_once_for_each_controller(seen):
    words = [
        "operator holds a force" if name == "surgeon_force" else name
        for name in seen["events"]
    ]
    assert sorted(seen["names"]) == sorted(words)
    assert words.count("puncture") == words.count("contact") == 2


def test_components_and_units(seen):
    assert seen["psi"] == ["11", "12", "21", "22"]
    assert seen["torque"] == ["shoulder", "elbow"]
    assert seen["units"] == ["1/kg", "N m", "rad/s"]
    assert seen["cursors"] == 3
