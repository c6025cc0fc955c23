"""Every message of every board, one class for each layout; importing this package fills the table."""
