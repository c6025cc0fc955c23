"""Ports: serial lines, TCP, recordings."""
