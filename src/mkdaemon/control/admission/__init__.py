"""One admission: what may begin, in which situation not, why, and what to do about it.

`rows.refusal(beginning, situation)` is asked at every beginning and at every change of manoeuvre.
"""
