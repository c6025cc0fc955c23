"""Everything that can be flown: one file each, and one table of all."""
