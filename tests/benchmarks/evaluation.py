"""One evaluation of the derivatives, by whatever evaluates them."""

from functools import partial

from benchmarks import straightforward
from benchmarks.comparison import CONTROLLER, DELAY, TARGETS
from benchmarks.contenders import Load
from benchmarks.measuring import Alternate, Options, Table

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.problem import EVALUATIONS
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.model.run.simulate import MakeDiagram


def Measure(options: Options) -> list[Table]:
    num_calls = 100 if options.quick else 2000
    rows = []
    for task in TARGETS:
        scenario = Load(task, CONTROLLER, DELAY)
        plain, _ = straightforward.MakeDiagram(
            scenario, lambda delay, value: straightforward.Delay(delay, value, 0.01)
        )
        ours = MakeDiagram(scenario)
        context = ours.CreateDefaultContext()
        run = CompiledRun(
            Evaluator(ours, context, as_machine_code=True),
            context,
            end=1e3,
            accuracy=1.0,
            max_step=1e-4,
        )
        run.Advance(1e-3)  # Compiles.
        calls = {
            "straightforward": partial(_InDrake, plain, num_calls),
            "package, in Drake": partial(_InDrake, ours, num_calls),
            "package, compiled": partial(_Compiled, run, num_calls),
        }
        measured = Alternate(calls, options.repeats)
        cost = {name: x.cpu / x.value for name, x in measured.items()}
        for name, seconds in cost.items():
            ratio = seconds / cost["straightforward"]
            rows.append(
                {"case": task, "contender": name, "us": 1e6 * seconds, "ratio": ratio}
            )
    note = (
        "CPU time of one of many, medians of alternating loops; the compiled ones "
        "have steps of 0.1 ms between them. The straightforward blocks are 1."
    )
    title = f"One evaluation of the derivatives, {DELAY:g} s each way"
    return [Table(title=title, note=note, rows=rows)]


def _InDrake(diagram, num_calls: int) -> int:
    context = diagram.CreateDefaultContext()
    for k in range(num_calls):
        context.SetTime(1e-4 * k)  # So that nothing is cached.
        context.get_mutable_continuous_state_vector()
        diagram.EvalTimeDerivatives(context)
    return num_calls


def _Compiled(run: CompiledRun, num_calls: int) -> int:
    before = run.memory.counts[EVALUATIONS]
    start = run.time
    run.Advance(start + 1e-3 * num_calls)
    return int(run.memory.counts[EVALUATIONS] - before)
