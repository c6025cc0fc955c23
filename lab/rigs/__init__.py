"""Test doubles that the campaigns and the tests share: virtual time, simulated boards at a port, whole daemons."""
