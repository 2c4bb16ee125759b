"""The mathematics of the thesis as pure functions of arrays, without Drake."""
