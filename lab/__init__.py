"""Campaigns and rigs: every figure in docs/ is measured here. Not part of the installed package."""
