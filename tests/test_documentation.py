"""The README and the pages of the documentation keep what they promise."""

import re
import shlex

import h5py
import numpy as np
import pytest
import yaml
from documentation import PAGES, ROOT, TEXT, Blocks, CheckPicture, CountWords
from grids import Slow
from runs import Run

from teleop_drake.cli import main
from teleop_drake.model.scenario import ARCHITECTURES, CONTROLLERS, LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.figures.runs import PlotComparison, SaveFigure
from teleop_drake.study.sweep import RunSweep
from teleop_drake.study.sweep.study import LoadStudy

LEAGUE = "teleop_drake/docs/architectures.md"


def Sentences(page):
    """The text of a page on one line."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def Anchors(text):
    """The anchors that GitHub makes of the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in headings}


LINKED = [
    *ROOT.glob("*.md"),
    *PAGES,
    *ROOT.glob("[!.]*/*.md"),
    *ROOT.glob("*/thesis/*.md"),
    *ROOT.glob("teleop_drake/*/README.md"),
]


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in Anchors(target.read_text("utf-8")), link


def test_every_page_is_in_the_index():
    index = (ROOT / "teleop_drake/docs/index.md").read_text(encoding="utf-8")
    assert len(PAGES) > 5
    for page in PAGES:
        assert page.stem == "index" or f"]({page.name})" in index


def test_words_outside_of_tables_and_code_are_counted():
    page = """# Two words
One <!-- not
these --> two three
| a table |

    code();
* a list
  goes on
```sh
more code
```
"""
    assert CountWords(page) == 3 + 3 + 3 + 2


def test_the_pages_can_be_read_in_an_hour():
    """A page that grows takes its words from another one."""
    words = {page.name: CountWords(page.read_text("utf-8")) for page in PAGES}
    assert sum(words.values()) <= 12_000, words


@pytest.mark.filterwarnings("error")
def test_examples_run(capsys, tmp_path, monkeypatch):
    """Each as a script of its own."""
    monkeypatch.chdir(tmp_path)
    blocks = Blocks("python")
    assert len(blocks) == 11
    for block in blocks:
        exec(block, {"__name__": "__main__"})
        assert capsys.readouterr().out


def test_command_lines_are_understood(tmp_path, monkeypatch):
    """Each line parses; what it would simulate is not simulated here."""
    from teleop_drake.cli.main import MakeParser
    from teleop_drake.thesis.report import CLAIMS

    monkeypatch.chdir(tmp_path)
    parser = MakeParser()
    (block,) = [b for b in Blocks("") if b.startswith("teleop-drake list")]
    lines = [re.split(r"\s{3,}", line)[0] for line in block.splitlines()]
    text = TEXT + " ".join(claim.reason for claim in CLAIMS)
    lines += re.findall(r"`(teleop-drake [a-z]+\s[^`>]+)[`>]", text)
    assert len(lines) >= 30
    for line in lines:
        assert parser.parse_args(shlex.split(line)[1:]).command, line


@pytest.mark.mostly_slow
@pytest.mark.parametrize("task", ["one_dof", "two_dof_collision"])
def test_delay_margins(task):
    (cells,) = re.findall(
        rf"^\| `{task}` \|((?: [\w.-]+ \|){{6}})$", TEXT, re.MULTILINE
    )
    cells = cells.replace("|", "").split()
    for i, kind in enumerate(CONTROLLERS):
        analysis = AnalyzeStability(LoadScenario(task, {"controller.kind": kind}))
        margins = {
            point["name"]: point["delay_margin"]
            for point in analysis.ToRecord()["operating_points"]
        }
        for layer, cell in zip(
            ("tissue", "free", "bone"), cells[3 * i :], strict=False
        ):
            if cell == "-":
                assert layer not in margins
            elif cell == "any":
                assert margins[layer] is None
            else:
                assert margins[layer] == pytest.approx(float(cell), rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", Slow(["one_dof", "two_dof_collision", "two_dof_combined"])
)
def test_the_adaptive_controller_taken_apart(task):
    """Each column of the page is what the study gives, in the order of its rows."""
    parts = {
        name.partition("-")[2]: RunSweep(plan).Table()
        for name, plan in LoadStudy("why_adaptive").plans.items()
        if name.startswith(f"{task}-")
    }
    adaptive, direct, to_ground = parts["laws"]
    order = ("no_networks", "no_psi", "no_adaptation", "no_velocity", "no_force")
    runs = [adaptive, *(parts[name][0] for name in order)]
    runs += [*parts["gains"], *parts["large_G2"], *parts["command"], to_ground, direct]
    newtons = 1000 if task == "one_dof" else 1

    def Cells(run):
        """Arrival with four digits, rest or a dash, and the largest force."""
        rest = run["collision.rest_time"]
        return [
            f"{run['collision.time']:.4g}",
            "-" if rest is None else f"{rest:.3g}",
            f"{newtons * run['collision.peak_force']:.3g}",
        ]

    page = (ROOT / "teleop_drake/docs/why_adaptive.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.startswith("| ")][1:]
    first = ("one_dof", "two_dof_collision", "two_dof_combined").index(task)
    cells = [[cell.strip() for cell in line.split("|")[2:-1]] for line in lines]
    assert [row[first::3] for row in cells] == [Cells(run) for run in runs]


def test_what_adaptation_changes_most_on_the_bone():
    """As the page on the adaptive controller reports of case II."""
    still = Run(
        "two_dof_collision", "adaptive_backstepping", "controller.adaptation_rate=0"
    )
    runs = Run("two_dof_collision", "adaptive_backstepping"), still
    before, after = (RunMetrics(run)["collision"]["settling_time"] for run in runs)
    page = Sentences("teleop_drake/docs/why_adaptive.md")
    assert f"of case II falls from {before:.2f} to {after:.2f} s" in page


@pytest.mark.parametrize(
    ("page", "sentence"),
    [
        ("README.md", "compares the nine control architectures"),
        ("teleop_drake/docs/index.md", "the nine control architectures"),
        (LEAGUE, "There are nine architectures"),
        (
            "notebooks/README.md",
            "Here the nine architectures of this package have the same surgeon",
        ),
    ],
)
def test_the_number_of_architectures(page, sentence):
    """Each is named on the league's page."""
    assert len(ARCHITECTURES) == 9
    assert sentence in Sentences(page)
    for kind in ARCHITECTURES:
        assert f"`{kind}`" in Sentences(LEAGUE)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("name", "adaptive", "robust"),
    Slow(
        [
            ("two_dof_collision", 1.97, 1.83),
            ("two_dof_combined", 1.31, 2.46),
            ("one_dof", 1.30, 5.13),
        ],
        but=[0, 1],
    ),
)
def test_the_robust_law_on_bone(name, adaptive, robust):
    """The times after which the velocity settles, as the league's page has them."""
    bound = "controller.robust.force_rate_bound=19"
    runs = Run(name, "adaptive_backstepping"), Run(name, "robust_backstepping", bound)
    for run, expected in zip(runs, (adaptive, robust), strict=True):
        found = RunMetrics(run)["collision"]["settling_time"]
        assert found == pytest.approx(expected, abs=0.005)
    assert f"{robust:.2f} s instead of {adaptive:.2f} s" in Sentences(LEAGUE)


def test_examples_of_channels_and_operators_are_valid(tmp_path):
    channel, trace, hand = map(yaml.safe_load, Blocks("yaml"))
    scenario = LoadScenario("one_dof", channel)
    assert scenario.forward_channel.receiver.policy == "playout"
    log = tmp_path / trace["trace"]["file"]
    log.write_text("stamp,host,round trip\n0,a,40000\n30000,a,42000\n")
    trace["trace"]["file"] = str(log)
    variable = {"kind": "variable", "delay": 0.0, **trace}
    scenario = LoadScenario("one_dof", {"forward_channel": variable})
    profile = scenario.forward_channel.Profile(25.0)
    assert profile(15.0) == pytest.approx(0.0205)
    episode = tmp_path / hand["surgeon"]["file"]["file"]
    with h5py.File(episode, "w") as file:
        file["timestamp"] = np.arange(100) / 50
        file["observations/qpos"] = np.arange(200.0).reshape(100, 2) / 1e5
    hand["surgeon"]["file"]["file"] = str(episode)
    surgeon = LoadScenario("one_dof", hand).surgeon
    assert "with a bandwidth of 5 Hz" in surgeon.MakePlan().notes[0]


@pytest.mark.slow
def test_figure_is_that_of_the_runs(tmp_path):
    recordings = {kind: Run("two_dof_combined", kind) for kind in CONTROLLERS}
    SaveFigure(PlotComparison(recordings), tmp_path / "now.png")
    CheckPicture(ROOT / "diagrams" / "two_dof_combined.png", tmp_path / "now.png")


@pytest.mark.slow
def test_map_is_that_of_the_sweep(tmp_path, monkeypatch):
    """By the command that the page on stability names."""
    monkeypatch.chdir(tmp_path)
    text = Sentences("teleop_drake/docs/stability.md")
    (command,) = re.findall(r"`teleop-drake (sweep one_dof [^`]*--vary[^`]*)`", text)
    assert main([*command.split(), "--metrics", "collision.time", "--quiet"]) == 0
    CheckPicture(PAGES[0].parent / "stability_map.png", "out/stability.png")
