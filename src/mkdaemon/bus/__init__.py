"""The Zenoh edge: keys, encodings, last values, queries."""
