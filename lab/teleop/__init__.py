"""`python -m lab teleop`: an operator's hands: pads lost in flight, and how fast a stick reaches the line."""
