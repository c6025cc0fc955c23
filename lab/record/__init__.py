"""What recording costs, and what is left of a recording after every bad end."""
