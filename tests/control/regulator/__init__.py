"""The guidance."""
