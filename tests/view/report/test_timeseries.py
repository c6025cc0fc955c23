"""Numbers over time, thinned for a plot."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.view.report.timeseries import TimeSeries, thin


@pytest.mark.parametrize("count", [0, 1, 5, 100, 101, 5000])
def test_a_thinned_line_keeps_its_ends_and_extremes(count):
    times = np.arange(count, dtype=float)
    values = np.sin(times / 30.0)
    if count == 5000:
        values[1234], values[4321] = 9.0, -9.0
    found_times, found = thin(times, values, 100)
    assert len(found) <= 102
    assert np.all(np.diff(found_times) > 0)
    assert set(zip(found_times, found, strict=True)) <= set(zip(times, values, strict=True))
    if count:
        assert (found_times[0], found_times[-1]) == (0.0, count - 1.0)
        assert (found.min(), found.max()) == (values.min(), values.max())


def test_values_are_sorted_by_time():
    series = TimeSeries()
    for at, value in ((2.0, 20.0), (1.0, 10.0), (3.0, 30.0)):
        series.add(at, value)
    times, values = series.arrays()
    assert times.tolist() == [1.0, 2.0, 3.0]
    assert values.tolist() == [10.0, 20.0, 30.0]
    assert len(series) == 3
