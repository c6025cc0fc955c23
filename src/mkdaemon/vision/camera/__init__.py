"""From a camera to stamped images: sources, clocks, intrinsics."""
