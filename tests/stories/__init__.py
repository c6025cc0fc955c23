"""The safety stories, a few of each; `python -m lab stories` tells them all."""
