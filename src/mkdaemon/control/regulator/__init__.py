"""From a wanted position to sticks: reference, regulators, shaping of counts."""
