"""`kill -9` during procedures, and what is left."""
