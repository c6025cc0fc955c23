"""`mkctl teleop`: gamepads, the keyboard and pads of other machines as the hands of an operator."""
