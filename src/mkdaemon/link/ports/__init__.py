"""What bytes come through: serial lines, TCP, recordings."""
