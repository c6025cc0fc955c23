"""Configuration sections as frozen models, and the one reader of TOML."""
