"""The kinds of blocks of a teleoperation loop: a folder for each seam."""
