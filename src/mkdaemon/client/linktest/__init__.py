"""How good a line is: link tests and stick frames with their answers, measured, judged and kept."""
