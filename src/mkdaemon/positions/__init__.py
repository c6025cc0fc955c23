"""Poses by a source outside, judged by the motion of the aircraft. Pure; it needs no camera and no OpenCV."""
