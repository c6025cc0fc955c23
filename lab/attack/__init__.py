"""Attacks on the daemon in flight; see `lab.attack.main`."""
