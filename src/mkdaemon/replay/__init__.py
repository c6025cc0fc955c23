"""A recording's inputs through today's code in virtual time, and what comes out compared with what was recorded."""
