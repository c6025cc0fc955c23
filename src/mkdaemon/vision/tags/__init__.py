"""Tags in one image: families, detection, outlines, target files."""
