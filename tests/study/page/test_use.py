"""The living diagram in class, in the hand, on paper, on a phone and in a notebook."""

import base64
import csv
import itertools
import re
import xml.etree.ElementTree as ElementTree

import pytest
from browsers import ReadAxe
from servo import Servo

from teleop_drake import MakePage, WritePage
from teleop_drake.cli import main
from teleop_drake.loops.page.colors import DARK_PAPER, LIGHT_PAPER, PageColor
from teleop_drake.model.scenario import LoadScenario, ScenarioNames
from teleop_drake.study.figures.style import COLORS

pytestmark = pytest.mark.xdist_group("browser")

STIFFNESS = "environment.layers.bone.stiffness"
PHONE = 390, 844


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "loop.html"
    WritePage("one_dof", path, vary={STIFFNESS: (50.0, 400.0)})
    return path


@pytest.fixture(scope="module")
def arm_page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "arm.html"
    WritePage("two_dof_combined", path)
    assert path.stat().st_size < 250_000
    return path


@pytest.mark.slow
def test_a_minute_without_instruction(look, page):
    seen = look(page, "minute.js")
    assert seen["title"] == "Tissue, then bone: two controllers, 0.1 s late"
    assert seen["story"].startswith("An operator pushes a tool through tissue")
    assert seen["tabs"].startswith("Diagram of")
    # Nothing is explained before it is asked for; then each part is, where it stands.
    assert set(seen["isHidden"]) == {0} and min(seen["heights"]) > 10
    assert set(seen["sections"]) == {"inputs", "task", "diagram", "scopes-section"}
    # 0.001 m/s is 1 mm/s.
    assert "[mm/s]" in seen["head"] and "command" in seen["head"]
    assert seen["hasCommand"] == 1
    events = ["puncture", "contact", "release", "operator holds a force"]
    assert sorted(seen["names"]) == sorted(2 * events)
    assert {"bone", "free"} <= set(seen["labels"])
    assert seen["main"] == 1 + 6 and seen["isFolded"]
    assert "peak force [mN]15.74" in seen["table"]
    (name, large), (kind, small) = seen["box"][:2]
    assert (name, kind) == ("forward channel", "TransportDelay")
    assert large > 1.5 * small


@pytest.mark.slow
def test_three_things_to_try_set_the_sliders(look, page):
    *three, (back, *values, _), (guess, *_) = look(page, "minute.js")["tries"]
    assert guess == "Guess first"
    assert three == [
        ["0 s late", 0, 0, ": two controllers, 0 s late"],
        ["0.3 s late", *2 * [pytest.approx(0.3)], ": two controllers, 0.3 s late"],
        [
            *("late on the way back only", 0, 0.2),
            ": two controllers, 0 s late there and 0.2 s back",
        ],
    ]
    assert (back, *values) == ("As it was", 0.1, 0.1)


@pytest.mark.slow
def test_components_have_names(look, arm_page):
    head = look(arm_page, "minute.js")["head"]
    assert re.search(r"direct force x [-\d.e]+, y [-\d.e]+", head)


@pytest.mark.parametrize("name", sorted(ScenarioNames()))
def test_every_scenario_has_a_title_and_two_sentences(name):
    scenario = LoadScenario(name)
    assert 5 < len(scenario.title) < 50
    assert len(re.findall(r"[.?](?: |$)", scenario.story)) == 2


@pytest.mark.slow
def test_a_drive_starts_by_itself_and_tells_how_it_ended(look, tmp_path):
    path = tmp_path / "drive.html"
    options = ["two_dof_collision", "--delay", "0.4", "--output", str(path)]
    assert main(["drive", *options, "--quiet"]) == 0
    seen = look(path, "start.js")
    # It begins with a gentle hand and the controller that survives.
    assert (seen["first"], seen["strength"]) == ("adaptive_backstepping", "0.5")
    assert seen["isArmIn"] and 0 < seen["boneAt"] < seen["width"]
    assert seen["key"] and seen["pad"]
    # 60 of 80 px, of half of the full speed.
    assert seen["pointer"] == pytest.approx(0.5 * 0.75)
    late = f"{seen['end'] - seen['push']:.1f}"
    start = f"Direct force ran away {late} s after you pushed: the tool exceeds its"
    assert seen["banner"].startswith(start)
    begin = (
        "two_dof_collision, direct force, delay each way 0.4 s, gentle hand; seed 0; "
    )
    assert seen["score"] == begin + "bone not reached"
    assert seen["whole"] == (
        begin + "bone after 1.25 s; largest force 0.83 N; at rest after 2.00 s; "
        "score 2.70 N s"
    )
    assert seen["next"][:3] == [
        "Again",
        "With adaptive backstepping",
        "This drive again, 0 s late",
    ]
    assert seen["again"] == {"isSame": True, "delay": 0, "isShown": True}


@pytest.mark.slow
def test_a_delay_of_zero_can_be_driven(look, tmp_path, capsys):
    path = tmp_path / "drive.html"
    assert main(["drive", "one_dof", "--delay", "0", "--output", str(path)]) == 0
    assert not capsys.readouterr().err
    seen = look(path, "nodelay.js")
    assert "delay each way 0 s" in seen["score"]
    assert min(seen["moved"]) > 0.4


@pytest.mark.slow
def test_paper(look, browser, arm_page):
    seen = look(arm_page, "paper.js")
    assert seen["controls"] == 0
    assert seen["lastTick"] <= seen["right"] <= 700
    # A4 without its margins, at 96 px an inch.
    assert seen["height"] < (297 - 24) / 25.4 * 96
    assert seen["values"] == "forward delay [s]: 0.1 · return delay [s]: 0.1"
    assert seen["rows"] == 1 + 6
    assert (seen["scheme"], seen["after"], seen["isBack"]) == ("light", "light", True)
    data = browser.Call("Page.printToPDF", preferCSSPageSize=True)["data"]
    assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(data))) == 1


@pytest.mark.slow
def test_curves_and_signals_are_saved(look, page):
    seen = look(page, "paper.js")
    root = ElementTree.fromstring(seen["svg"])
    lines = root.findall(".//{http://www.w3.org/2000/svg}polyline")
    # Two controllers in three scopes, and the command.
    assert len(lines) == 2 * 3 + 1
    assert all("stroke: rgb(" in line.get("style") for line in lines)
    rows = list(csv.reader(seen["csv"].splitlines()))
    assert rows[0] == [
        *("controller", "time", "robot:tool_velocity"),
        *("environment:environment_force", "robot:tool_position"),
    ]
    assert {len(row) for row in rows} == {5}
    assert {row[0] for row in rows[1:]} == {"direct_force", "adaptive_backstepping"}
    assert max(float(row[1]) for row in rows[1:]) == 25.0


@pytest.mark.slow
def test_a_phone(look, arm_page):
    seen = look(arm_page, "phone.js", size=PHONE)
    assert seen["width"] == PHONE[0]
    assert seen["tops"] == sorted(seen["tops"])
    assert seen["small"] == []
    assert seen["share"] == pytest.approx(1.0, abs=0.02)


def Contrast(one, other):
    """WCAG 2.2 of two colours from 0 to 255."""

    def Luminance(color):
        parts = [x / 255 for x in color]
        linear = [
            x / 12.92 if x <= 0.03928 else ((x + 0.055) / 1.055) ** 2.4 for x in parts
        ]
        return sum(w * x for w, x in zip((0.2126, 0.7152, 0.0722), linear, strict=True))

    light, dark = sorted((Luminance(one), Luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("index", range(len(COLORS)))
def test_every_color_is_legible(index):
    light, dark = re.findall("#(......)", PageColor(index))
    for color, paper in ((light, LIGHT_PAPER), (dark, DARK_PAPER)):
        assert Contrast(bytes.fromhex(color), bytes.fromhex(paper[1:])) >= 4.5


@pytest.mark.slow
@pytest.mark.parametrize("is_dark", [False, True], ids=["light", "dark"])
def test_everybody(look, page, is_dark):
    seen = look(page, "everybody.js", is_dark=is_dark)
    # The first stop skips to the sliders, which are near in any case.
    assert seen["stops"][0] == "A"
    assert seen["stops"].index("range") <= 8
    assert all(seen["labels"])
    assert "block robot Diagram, opens; 8 ports" in seen["labels"]
    assert "output tool_velocity of robot" in seen["labels"]
    for color, paper in itertools.product(seen["lines"], seen["papers"]):
        assert Contrast(color, paper) >= 4.5, (color, paper)
    for color, paper in itertools.product(seen["texts"], seen["papers"]):
        assert Contrast(color, paper) >= 4.5, (color, paper)
    panel = "#" + "".join(f"{x:02x}" for x in seen["papers"][1])
    assert panel == (DARK_PAPER if is_dark else LIGHT_PAPER)


def _WriteWithLateWires(path):
    WritePage(Servo, path, delays="all")


def _WriteDrive(path):
    WritePage("one_dof", path, has_hand=True)


def _WriteArm(path):
    WritePage("two_dof_combined", path)


@pytest.mark.slow
@pytest.mark.parametrize("is_dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("write", [_WriteArm, _WriteDrive, _WriteWithLateWires])
def test_axe_finds_nothing(look, tmp_path, write, is_dark):
    path = tmp_path / "page.html"
    write(path)
    text = path.read_text("utf-8")
    script = f"<script>{ReadAxe()}</script></body>"
    path.write_text(text.replace("</body>", script), "utf-8")
    assert look(path, "axe.js", is_dark=is_dark) == []


@pytest.mark.slow
def test_search(look, page):
    seen = look(page, "search.js")
    assert seen["first"] == "direct_force"
    # psi is in the adaptive controller alone.
    assert seen["port"][0] == "adaptive_backstepping"
    assert seen["isPlotted"]
    assert seen["part"][2].startswith("found forward_channel in")
    assert seen["nothing"][2:] == [
        "no block or port has \N{LEFT DOUBLE QUOTATION MARK}zzz"
        "\N{RIGHT DOUBLE QUOTATION MARK} in its name",
        "zzz",
    ]


@pytest.mark.slow
def test_a_link_is_a_state(look, page):
    link = f"#delay=0.2&{STIFFNESS}=111&controller=adaptive_backstepping&t=2.4"
    first = look(
        page, "link.js", link=f"{link}&show=tool_position,master:forward_packet"
    )
    second = look(page, "link.js", link="#" + first["link"].partition("#")[2])
    for seen in (first, second):
        assert seen["delay"] == 0.2 and seen["stiffness"] == 111
        assert seen["kind"] == "adaptive_backstepping"
        assert seen["cursor"] == 2.4
        assert seen["scopes"] == ["robot:tool_position", "master:forward_packet"]


@pytest.mark.slow
def test_a_link_that_is_wrong_is_reported(look, page):
    seen = look(page, "link.js", link="#delay=9&controller=none&show=nothing&t=1")
    assert seen["cursor"] == 1 and seen["delay"] == 0.1
    for words in ("delay = 9: must be from", "controller none: must be one of"):
        assert words in seen["status"]
    assert "there is no signal nothing" in seen["status"]


@pytest.mark.slow
@pytest.mark.parametrize("blank", ["", "%20", "abc"])
def test_a_blank_number_in_a_link_is_reported(look, page, blank):
    """JavaScript's Number("") is 0."""
    seen = look(page, "link.js", link=f"#delay={blank}&{STIFFNESS}=111&t={blank}")
    assert seen["delay"] == 0.1 and seen["stiffness"] == 111
    for words in ("delay = NaN: must be from 0 to 0.5", "t: must be a number"):
        assert words in seen["status"]


@pytest.mark.slow
def test_a_blank_number_field_gives_way_to_the_present_number(look, page):
    seen = look(page, "blank.js")
    assert seen["status"] == "delay = NaN: must be from 0 to 0.5"
    assert seen["delay"] == 0.1 and seen["shown"] == "0.1"
    assert seen["text"] == 'delay = "0.2": must be from 0 to 0.5'


@pytest.mark.slow
def test_the_frame_of_a_notebook_fits_the_page(look, tmp_path):
    """As a saved notebook and exported HTML have it: without a kernel."""
    frame = MakePage("one_dof")._repr_html_()
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><script>teleop = 0</script>{frame}", "utf-8")
    seen = look(path, "frame.js")
    assert seen["count"] == 3
    assert seen["bottom"] <= seen["page"] <= seen["height"]
    assert seen["run"] > 100
