"""The sentences about the league, each with its rows, which have to support it."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import NamedTuple

from league.statistics import ReadTable, Row

Key = tuple[str, ...]
"""Architecture, member and group of runs of a row of league.csv; architecture and
member of a row of league_felt.csv; the architecture of all rows of league_search.csv.
"""


class Claim(NamedTuple):
    """A sentence, the rows that it speaks of, and what has to be true of them.

    Attributes:
        text: A format string with the fields of the rows.
        rows: The rows by the names in the text.
        holds: Whether the words of the sentence are right.
    """

    text: str
    rows: Mapping[str, Key]
    holds: Callable[[SimpleNamespace], bool]

    def Rows(self) -> SimpleNamespace:
        """Returns the rows, whose cells are attributes."""
        return SimpleNamespace(
            **{name: SimpleNamespace(**FindRow(key)) for name, key in self.rows.items()}
        )

    def Sentence(self) -> str:
        """Returns the sentence with its numbers."""
        return self.text.format(**vars(self.Rows())).replace("%", " %")

    def Render(self) -> str:
        """Returns the sentence, and after it the keys of its rows."""
        keys = dict.fromkeys(", ".join(key) for key in self.rows.values())
        return f"{self.Sentence()} *[{'; '.join(keys)}]*"


def FindRow(key: Key) -> Row:
    """Returns the row of a key; for searches the costs and their spread."""
    columns = ("architecture", "member", "runs")[: len(key)]
    table = ReadTable(("league_search", "league_felt", "league")[len(key) - 1])
    rows = [row for row in table if tuple(row[column] for column in columns) == key]
    if len(key) == 1:
        costs = [row["cost"] for row in rows]
        spread = max(costs) / min(costs) - 1
        return {"least": min(costs), "most": max(costs), "spread": spread} | {
            name: min(row[name] for row in rows)
            for name in rows[0]
            if name.startswith("cost_2_")
        }
    (row,) = rows
    return row


def _All(architecture: str, member: str = "compromise", runs: str = "all") -> Key:
    """Returns the key of a row of league.csv."""
    return architecture, member, runs


def _Least(column: str, table: str = "league") -> float:
    """Returns the least number of all compromises in a column of a table."""
    return min(
        row[column]
        for row in ReadTable(table)
        if row["member"] == "compromise" and row.get("runs", "all") == "all"
    )


_DIRECT = _All("direct force")
_GROUND = _All("damper to ground")
_COMMAND = _All("damper to command")
_ADAPTIVE = _All("adaptive")
_CORE = _All("linear core")
_WAVES = _All("waves")

CLAIMS = (
    Claim(
        "**A plain damper does most of it.** Direct force comes to rest in "
        "{direct.at_rest:.0%} of the held-out runs, with a damper against the command "
        "in {command.at_rest:.0%}.",
        {"direct": _DIRECT, "command": _COMMAND},
        lambda r: r.direct.at_rest < 0.05 and r.command.at_rest > 0.97,
    ),
    Claim(
        "**Braking against the ground costs time,** {ground.arrival:.2f} instead of "
        "{command.arrival:.2f} times the commanded time, but lowers the largest force.",
        {"ground": _GROUND, "command": _COMMAND},
        lambda r: (
            r.ground.arrival_low > r.command.arrival_high
            and r.ground.impact_high < r.command.impact_low
        ),
    ),
    Claim(
        "**A search brings the adaptive controller close to the damper against the "
        "command.** With the thesis's gains it rests after {rule.rest:.2f} s in the "
        "median, its compromise after {adaptive.rest:.2f} s. It costs {cost.least:.2f} "
        "to {cost.most:.2f} points in training, the damper {other.least:.2f} to "
        "{other.most:.2f}. It rests sooner than the damper in "
        "{adaptive.rests_sooner:.0%} of the runs.",
        {
            "rule": _All("adaptive", "rule"),
            "adaptive": _ADAPTIVE,
            "command": _COMMAND,
            "cost": ("adaptive",),
            "other": ("damper to command",),
        },
        lambda r: (
            r.cost.least > r.other.most
            and r.rule.rest > 2 * r.adaptive.rest
            and r.adaptive.rests_sooner < 0.5
        ),
    ),
    Claim(
        "**With an ideal drive the linear core is the best.** Of all compromises it "
        "rests soonest and has the smallest force. It has neither a network nor Psi.",
        {"core": _CORE, "felt": _CORE[:2]},
        lambda r: (
            r.core.rest == _Least("rest")
            and r.core.impact == _Least("impact")
            and r.core.arrival < 1.05
        ),
    ),
    Claim(
        "**The linear core depends on the drive and the force sensor.** With hardware "
        "that is not ideal it rests in {core.at_rest:.0%} of the runs; the damper "
        "against the command, without a force sensor, in {command.at_rest:.0%}.",
        {
            "core": _All("linear core", runs="hardware"),
            "command": _All("damper to command", runs="hardware"),
        },
        lambda r: r.core.at_rest < r.command.at_rest == 1,
    ),
    Claim(
        "**Absolutely stable architectures hide the bone.** Waves, P+d and "
        "position-position have a Llewellyn parameter of at least 1, and lose more "
        "than 80% of the stiffness at 1 rad/s. Direct force, the dampers and the "
        "adaptive controller lose less than a tenth, and in each a port generates "
        "energy.",
        {
            "waves": _WAVES[:2],
            "pd": ("P+d", "compromise"),
            "pp": ("position-position", "compromise"),
            "direct": _DIRECT[:2],
            "ground": _GROUND[:2],
            "command": _COMMAND[:2],
            "adaptive": _ADAPTIVE[:2],
        },
        lambda r: (
            min(x.llewellyn for x in (r.waves, r.pd, r.pp)) >= 0.9999
            and min(x.loss_at_1 for x in (r.waves, r.pd, r.pp)) > 0.8
            and all(
                x.llewellyn < 0 and x.loss_at_1 < 0.1
                for x in (r.direct, r.ground, r.command, r.adaptive)
            )
        ),
    ),
    Claim(
        "**The order does not depend on the weights.** Whichever term counts twice, "
        "the linear core costs least, then the damper against the command, then the "
        "adaptive controller. With equal weights they cost {core.least:.2f}, "
        "{command.least:.2f} and {adaptive.least:.2f} points at least, waves "
        "{waves.least:.2f}, the four channels {four.least:.2f}.",
        {
            "core": ("linear core",),
            "command": ("damper to command",),
            "adaptive": ("adaptive",),
            "waves": ("waves",),
            "four": ("four channels",),
        },
        lambda r: all(
            getattr(r.core, f"cost_2_{term}")
            < getattr(r.command, f"cost_2_{term}")
            < getattr(r.adaptive, f"cost_2_{term}")
            < min(getattr(x, f"cost_2_{term}") for x in (r.waves, r.four))
            for term in ("rest", "late", "impact", "loss")
        ),
    ),
    Claim(
        "**Waves come to rest gently and arrive late,** after {waves.arrival:.2f} "
        "times the commanded time.",
        {"waves": _WAVES, "command": _COMMAND},
        lambda r: (
            0.99 < r.waves.at_rest < 1
            and r.waves.impact_high < r.command.impact_low
            and r.waves.arrival_low > 1.2
        ),
    ),
    Claim(
        "**A model of the bone makes the Smith predictor transparent.** Its "
        "compromise, whose model is almost as stiff as the bone, loses the least "
        "stiffness from 0.3 to 10 rad/s; its gentlest set, with almost no bone in the "
        "model, loses {gentle.loss_in_band:.0%}. On other bones the compromise rests "
        "in {bone.at_rest:.0%} of the runs.",
        {
            "smith": ("Smith + damper", "compromise"),
            "gentle": ("Smith + damper", "gentlest"),
            "bone": _All("Smith + damper", runs="bone"),
        },
        lambda r: (
            r.smith.loss_in_band == _Least("loss_in_band", "league_felt")
            and r.gentle.loss_in_band > 0.8
        ),
    ),
    Claim(
        "**Passivity control adds nothing to a damper.** Time to rest and largest "
        "force are those of the damper against the ground, to 0.02 s and 0.02 times a "
        "free mass's.",
        {"passive": _All("passivity + damper"), "ground": _GROUND},
        lambda r: (
            abs(r.passive.rest - r.ground.rest) < 0.02
            and abs(r.passive.impact - r.ground.impact) < 0.02
        ),
    ),
    Claim(
        "**PD at the slave, P+d and the four channels do not always rest.** At other "
        "delays PD at the slave and the four channels rest in {pd_delay.at_rest:.0%} "
        "and {four_delay.at_rest:.0%} of the runs.",
        {
            "pd": _All("PD at the slave"),
            "p_d": _All("P+d"),
            "four": _All("four channels"),
            "pd_delay": _All("PD at the slave", runs="delay"),
            "four_delay": _All("four channels", runs="delay"),
        },
        lambda r: max(x.at_rest for x in (r.pd, r.p_d, r.four)) < 1,
    ),
    Claim(
        "**Two searches have not converged.** From search to search the least cost "
        "differs by {pd.spread:.0%} for PD at the slave and by {p_d.spread:.0%} for "
        "P+d, and by less than 5% for all others.",
        {"pd": ("PD at the slave",), "p_d": ("P+d",)},
        lambda r: (
            r.pd.spread > 0.05
            and r.p_d.spread > 0.05
            and all(
                FindRow((row["architecture"],))["spread"] < 0.05
                for row in ReadTable("league_search")
                if row["architecture"] not in ("PD at the slave", "P+d")
            )
        ),
    ),
)
