"""The proving ground: the user's genuine firmware runs in virtual time; see docs/lab/genuine*.md."""
