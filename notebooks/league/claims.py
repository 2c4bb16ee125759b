"""The sentences about the league, each with its rows, which have to support it.

Each speaks of rows, found in the ranges of entries.yaml, not of methods. The plainest
changes must not refute it: other bones, ranges that are twice as wide, and the winner's
damper for a loser that has none.
"""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import NamedTuple

from league.statistics import ReadTable, Row

Key = tuple[str, ...]
"""Architecture, member and group of runs of a row of league.csv; architecture and
member of a row of league_felt.csv; the architecture of all rows of league_search.csv.
"""

CHANGES = ("other bones", "twice the range", "the same damper")
"""The changes that try to refute a sentence."""

SAME_DAMPER = {
    "direct force": "damper to command",
    "damper to ground": "damper to command",
    "waves to ground": "waves",
}
"""The entries whose tool or hand has no damper against the command, with it."""

NOT_WIDENED = ("direct force",)
"""The entries without a search in wider ranges, whose own rows stay."""


class Claim(NamedTuple):
    """A sentence, the rows that it speaks of, and what has to be true of them.

    Attributes:
        text: A format string with the fields of the rows.
        rows: The rows by the names in the text.
        holds: Whether the words of the sentence are right.
        topic: The change that the sentence itself is about, if there is one.
    """

    text: str
    rows: Mapping[str, Key]
    holds: Callable[[SimpleNamespace], bool]
    topic: str = ""

    def Rows(self, change: str = "") -> SimpleNamespace:
        """Returns the rows, whose cells are attributes, after one of CHANGES."""
        return SimpleNamespace(
            **{
                name: SimpleNamespace(**ChangedRow(key, change))
                for name, key in self.rows.items()
            }
        )

    def Sentence(self) -> str:
        """Returns the sentence with its numbers."""
        return self.text.format(**vars(self.Rows())).replace("%", " %")


def FindRow(key: Key) -> Row:
    """Returns the row of a key; for searches the costs and their spread."""
    columns = ("architecture", "member", "runs")[: len(key)]
    table = ReadTable(("league_search", "league_felt", "league")[len(key) - 1])
    rows = [row for row in table if tuple(row[column] for column in columns) == key]
    if len(key) == 1:
        costs = [row["cost"] for row in rows]
        spread = max(costs) / min(costs) - 1
        (twice,) = (x["cost_twice"] for x in rows if x["cost_twice"] != "")
        return {"least": min(costs), "most": max(costs), "spread": spread} | {
            "twice": twice,
            "count": len(costs),
        }
    (row,) = rows
    return row


def ChangedRow(key: Key, change: str) -> Row:
    """Returns the row of a key after one of CHANGES, or as it is."""
    architecture, *others = key
    if change == "the same damper":
        return FindRow((SAME_DAMPER.get(architecture, architecture), *others))
    if change == "other bones":
        if len(key) == 3:
            return FindRow((*key[:2], "bone"))
        row = FindRow(key)
        stiff = {x: row[f"{x}_600"] for x in ("loss_at_1", "loss_in_band") if x in row}
        return row | stiff
    if change == "twice the range":
        if len(key) == 1 and architecture not in NOT_WIDENED:
            row = FindRow(key)
            return row | {"least": row["twice"]}
        if key[1] == "compromise" and architecture not in NOT_WIDENED:
            return FindRow((architecture, "twice the range", *key[2:]))
    return FindRow(key)


def _All(architecture: str, member: str = "compromise", runs: str = "all") -> Key:
    """Returns the key of a row of league.csv."""
    return architecture, member, runs


def _Spread(felt: SimpleNamespace) -> float:
    """Returns by how much the loss in the band differs between the soft bones."""
    return abs(float(felt.loss_in_band_300 - felt.loss_in_band_600))


_COMMAND = _All("damper to command")
_GROUND = _All("damper to ground")
_ADAPTIVE = _All("adaptive")
_CORE = _All("linear core")
_WAVES = _All("waves")
_SLOW_WAVES = _All("waves to ground")
_SMITH = _All("Smith + damper")

CLAIMS = (
    Claim(
        "**A damper does most of it.** Direct force comes to rest in "
        "{direct.at_rest:.0%} of the held-out runs, with a damper against the command "
        "in {command.at_rest:.0%}, after {command.rest:.2f} s.",
        {"direct": _All("direct force"), "command": _COMMAND},
        lambda r: r.direct.at_rest < 0.2 and r.command.at_rest > 0.95,
        topic="the same damper",
    ),
    Claim(
        "**Braking against the ground costs time,** at the tool {ground.arrival:.2f} "
        "instead of {command.arrival:.2f} times the commanded time, with waves "
        "{slow.arrival:.2f} instead of {waves.arrival:.2f}. The largest force is "
        "smaller: {ground.impact:.2f} instead of {command.impact:.2f}, and "
        "{slow.impact:.2f} instead of {waves.impact:.2f} times a free mass's.",
        {"ground": _GROUND, "command": _COMMAND, "slow": _SLOW_WAVES, "waves": _WAVES},
        lambda r: (
            r.ground.arrival > r.command.arrival + 0.1
            and r.slow.arrival > r.waves.arrival + 0.1
            and r.ground.impact < r.command.impact
            and r.slow.impact < r.waves.impact
        ),
        topic="the same damper",
    ),
    Claim(
        "**Waves can be passive and quick.** With the hand's damper against the "
        "command they rest after {waves.rest:.2f} s in {waves.at_rest:.0%} of the "
        "runs, and arrive after {waves.arrival:.2f} times the commanded time; the "
        "damper at the tool, which is not passive, after {command.rest:.2f} s and "
        "{command.arrival:.2f}. Llewellyn's parameter is {felt.llewellyn:.2f}. "
        "[Details](passive_and_quick.md).",
        {"waves": _WAVES, "felt": _WAVES[:2], "command": _COMMAND},
        lambda r: (
            r.felt.llewellyn >= 0.9999
            and r.waves.at_rest > 0.95
            and r.waves.arrival < r.command.arrival + 0.1
            and r.waves.rest < r.command.rest + 0.15
        ),
    ),
    Claim(
        "**What waves hide depends on their impedance and on the bone.** At 1 rad/s "
        "the compromise loses {felt.loss_at_1:.0%} of a bone of 150 N/m and "
        "{felt.loss_at_1_600:.0%} of one of 600 N/m, the gains by rule "
        "{rule.loss_at_1:.0%} of 150 N/m; the damper at the tool loses "
        "{command.loss_at_1:.0%}.",
        {
            "felt": _WAVES[:2],
            "rule": ("waves", "rule"),
            "command": _COMMAND[:2],
        },
        lambda r: r.command.loss_at_1 < 0.1 < r.felt.loss_at_1 < r.rule.loss_at_1,
    ),
    Claim(
        "**The linear core costs least in training,** {core.least:.2f} to "
        "{core.most:.2f} points, the adaptive controller {adaptive.least:.2f} to "
        "{adaptive.most:.2f}, the damper against the command {command.least:.2f}, "
        "waves {waves.least:.2f}. The core rests after {row.rest:.2f} s, with "
        "hardware in {hardware.at_rest:.0%} of the runs.",
        {
            "core": ("linear core",),
            "adaptive": ("adaptive",),
            "command": ("damper to command",),
            "waves": ("waves",),
            "row": _CORE,
            "hardware": _All("linear core", runs="hardware"),
        },
        lambda r: r.core.least < r.adaptive.least < r.command.least < r.waves.least,
    ),
    Claim(
        "**Quick is laborious.** The total variation of the control force is "
        "{core.effort:.1f} with the core (on hardware {hardware.effort:.1f}), "
        "{adaptive.effort:.1f} with the adaptive controller, {command.effort:.1f} with "
        "the damper against the command and {ground.effort:.1f} with that against the "
        "ground, in multiples of a free mass's impact.",
        {
            "core": _CORE,
            "hardware": _All("linear core", runs="hardware"),
            "adaptive": _ADAPTIVE,
            "command": _COMMAND,
            "ground": _GROUND,
        },
        lambda r: r.ground.effort < min(r.command.effort, r.core.effort),
        topic="the same damper",
    ),
    Claim(
        "**What the Smith predictor loses depends on the bone,** because its model has "
        "one. Of 150, 300 and "
        "600 N/m it loses {smith.loss_in_band:.0%}, {smith.loss_in_band_300:.0%} and "
        "{smith.loss_in_band_600:.0%} from 0.3 to 10 rad/s, the damper against the "
        "command {command.loss_in_band:.0%}, {command.loss_in_band_300:.0%} and "
        "{command.loss_in_band_600:.0%}.",
        {"smith": _SMITH[:2], "command": _COMMAND[:2]},
        lambda r: _Spread(r.smith) > _Spread(r.command),
    ),
    Claim(
        "**Passivity control adds little to its damper.** It rests after "
        "{passive.rest:.2f} s with {passive.impact:.2f} times a free mass's force, the "
        "damper alone after {command.rest:.2f} s with {command.impact:.2f}.",
        {"passive": _All("passivity + damper"), "command": _COMMAND},
        lambda r: (
            abs(r.passive.rest - r.command.rest) < 0.15
            and abs(r.passive.impact - r.command.impact) < 0.35
        ),
    ),
    Claim(
        "**P+d, PD at the slave and the four channels are slower in these ranges.** "
        "They rest after {p_d.rest:.2f}, {pd.rest:.2f} and {four.rest:.2f} s in "
        "{p_d.at_rest:.0%}, {pd.at_rest:.0%} and {four.at_rest:.0%} of the runs.",
        {
            "p_d": _All("P+d"),
            "pd": _All("PD at the slave"),
            "four": _All("four channels"),
            "command": _COMMAND,
        },
        lambda r: min(r.p_d.rest, r.pd.rest, r.four.rest) > r.command.rest,
    ),
    Claim(
        "**Searches with three gains have not converged.** The least cost differs from "
        "search to search by {pd.spread:.0%} for PD at the slave, {p_d.spread:.0%} for "
        "P+d and {adaptive.spread:.0%} for the adaptive controller.",
        {
            "pd": ("PD at the slave",),
            "p_d": ("P+d",),
            "adaptive": ("adaptive",),
        },
        lambda r: min(r.pd.spread, r.p_d.spread, r.adaptive.spread) > 0.1,
    ),
)
