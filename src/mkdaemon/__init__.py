"""Ground and companion software for MikroKopter aircraft."""
