"""The names of the blocks, their signatures, and what their docstrings tell."""

import functools
import importlib
import inspect
import pkgutil
import pydoc
import re

import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.framework import LeafSystem, System
from test_block_table import FOLDERS, SCENES

import teleop_drake
from teleop_drake import blocks
from teleop_drake.blocks import FunctionLaw
from teleop_drake.loops.framework.signals import PathsIn
from teleop_drake.loops.framework.validation import Range
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.model.run.simulate import MakeDiagram
from teleop_drake.model.scenario import LoadScenario


def PublicBlocks():
    """Yields each class of systems of the package that a user may make."""
    for module in pkgutil.walk_packages(teleop_drake.__path__, "teleop_drake."):
        if not set(module.name.split(".")) & {*FOLDERS}:
            continue
        for name, kind in vars(importlib.import_module(module.name)).items():
            is_block = isinstance(kind, type) and issubclass(kind, System)
            if is_block and kind.__module__ == module.name and name[0] != "_":
                yield kind


BASES = {
    *("ChannelBlock", "LawBlock", "MasterSide", "SlaveSide", "ModalOperator", "Wall")
}
BLOCKS = [kind for kind in PublicBlocks() if kind.__name__ not in BASES]


def ParameterTable(kind):
    """Returns index, name and unit of the parameters in the docstring of a block."""
    rows = re.findall(r"^\| (\d+) +\| (\w+) +\| (.+?) +\|$", inspect.getdoc(kind), re.M)
    return [(int(index), name, unit) for index, name, unit in rows]


@pytest.mark.parametrize("kind", BLOCKS, ids=lambda kind: kind.__name__)
def test_every_block_has_a_public_name(kind):
    assert getattr(teleop_drake, kind.__name__) is kind
    assert getattr(blocks, kind.__name__) is kind
    assert kind.__name__ in dir(blocks)


@pytest.mark.parametrize("name", blocks.__all__)
def test_every_name_of_the_blocks_is_there(name):
    assert getattr(blocks, name) is getattr(teleop_drake, name)


def test_an_unknown_block_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"'teleop_drake.blocks' .* 'Transport'"):
        _ = blocks.Transport


def test_the_leading_arguments_have_places_as_in_drake():
    delay = blocks.TransportDelay(0.1, 2, [1.0, 2.0])
    context = delay.CreateDefaultContext()
    assert_array_equal(delay.get_output_port().Eval(context), [1.0, 2.0])
    assert delay.delay == 0.1
    layer = blocks.LayerConfig(name="free", start=0.0)
    assert blocks.LayeredForceField([layer], 2).get_input_port(0).size() == 2
    assert blocks.HapticDevice([1.0], [1.0, 2.0], 3).get_output_port().size() == 3
    assert blocks.ConstantVelocityOperator([0.1, 0.2]).get_input_port(0).size() == 2
    assert blocks.DampedForce(2, 1.5).get_input_port(0).size() == 2


@pytest.mark.parametrize("kind", BLOCKS, ids=lambda kind: kind.__name__)
def test_signatures_can_be_read(kind):
    shown = str(inspect.signature(kind))
    assert "_NestedSequence" not in shown
    assert "**" not in shown


def test_help_of_a_block_shows_its_own_methods_first():
    text = pydoc.render_doc(blocks.TransportDelay, renderer=pydoc.plaintext)
    own = text.index("NextJumpTime")
    assert own < text.index("inherited from pydrake.systems.framework.LeafSystem")
    # No text of Drake's stands before it.
    assert "raw:: html" not in text[:own]
    declare = KernelBlock.DeclarePeriodicPublishEvent
    assert declare.__name__ == "DeclarePeriodicPublishEvent"
    assert hasattr(LeafSystem, declare.__name__)


@functools.cache
def KernelBlocks():
    """Returns a block of each class that has parameters, from built diagrams."""
    found = {}
    for name, changes in SCENES:
        diagram = MakeDiagram(LoadScenario(name, {**changes, "duration": 2.0}))
        for system, _ in PathsIn(diagram):
            # The parameters of a FunctionLaw are those of its function.
            if isinstance(system, KernelBlock) and type(system) is not FunctionLaw:
                found.setdefault(type(system), system)
    return found


@pytest.mark.slow
def test_docstrings_name_the_parameters_of_the_contexts():
    found = KernelBlocks()
    tables = {kind.__name__: ParameterTable(kind) for kind in found}
    expected = {
        kind.__name__: [
            (x.number, x.name, x.unit or "-") for x in block.kernel_parameters.named
        ]
        for kind, block in found.items()
    }
    assert tables == expected
    assert sum(len(rows) > 0 for rows in tables.values()) >= 15


@pytest.mark.slow
def test_every_parameter_of_a_block_has_a_range():
    ranges = [
        number.range
        for block in KernelBlocks().values()
        for number in block.kernel_parameters.named
    ]
    assert len(ranges) > 50
    assert all(isinstance(x, Range) for x in ranges)
