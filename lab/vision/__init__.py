"""Detection and poses on rendered and photographed images."""
