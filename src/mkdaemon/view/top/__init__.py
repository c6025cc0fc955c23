"""The terminal view: pure panels of 80 columns, and the program that shows them."""
