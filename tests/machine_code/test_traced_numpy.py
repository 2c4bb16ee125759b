"""The functions that a law may call; test_compiled.py calls them."""

import builtins
import math
import re

import numpy as np

from teleop_drake import machine_code
from teleop_drake.machine_code.symbols import FUNCTIONS, UFUNCS
from teleop_drake.machine_code.traced_numpy import REPLACED


def test_the_page_lists_what_is_known():
    page = machine_code.__doc__.split("Functions that a law may call")[1]
    for title, module in {
        "numpy": np, "numpy.linalg": np.linalg, "math": math, "Python": builtins
    }.items():  # fmt: skip
        listed = re.search(rf"\* {re.escape(title)}: ([^.]*)\.", page)[1]
        known = {
            function.__name__
            for function in {*UFUNCS, *FUNCTIONS, *REPLACED}
            if getattr(module, function.__name__, None) is function
            and not (module is np and isinstance(function, type))
        }
        assert set(re.split(r",\s+", listed)) == known
