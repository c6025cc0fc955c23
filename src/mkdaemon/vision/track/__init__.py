"""From pose to pose: tracks, rival hypotheses, what is published."""
