"""What is asked of the operator and the robot, and what counts."""
