"""Haptic teleoperation under communication delay as Drake systems diagrams.

The model of P. P. Sarda, "Control of a Teleoperating Robotic Arm Subject to Time
Delays", MS thesis, The University of Texas at Arlington, 2012.
"""
