"""The link under load: losses, latencies, recovery."""
