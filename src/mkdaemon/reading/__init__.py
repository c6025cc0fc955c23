"""What the published values of a vehicle mean together: words, tones and ages for every screen. Pure, no I/O.

`Reading.take` keeps the last values; `Reading.at` returns the picture of a moment: facts, alarms, causes, commands.
"""

from mkdaemon.bus.keys import find as key_spec
from mkdaemon.bus.keys import fresh_for
from mkdaemon.reading.eventlines import EventLine, Sort, line_of
from mkdaemon.reading.facts import Fact
from mkdaemon.reading.known import Known
from mkdaemon.reading.picture import Offer, Picture, Reading

__all__ = ["EventLine", "Fact", "Known", "Offer", "Picture", "Reading", "Sort", "fresh_for", "key_spec", "line_of"]
