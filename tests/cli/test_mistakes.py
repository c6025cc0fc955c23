"""Mistakes of a user, whichever command meets them: one line that says what is wrong, an exit code, nothing written."""

from __future__ import annotations

import re
import shlex

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, run
from mkdaemon.vision.camera.calibration_file import Camera, save_camera
from mksim.scene.camera import BUILT_IN
from tests.places import CONFIGS, DATA

PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}
SURVEY = "mkdaemon calibrate map {} --camera lens.toml -o map.toml"
"""A survey with its sources and sizes in the middle."""
NOWHERE = " --connect tcp/127.0.0.1:1"
CONFIG = [
    ("mkdaemon detect missing.png", "no such picture, folder or video: missing.png"),
    ("mkdaemon detect empty", "no pictures in empty"),
    ("mkdaemon detect text.png --intrinsics 1,2,3", "intrinsics '1,2,3'"),
    ("mkdaemon detect text.png --intrinsics -1,2,3,4", "intrinsics '-1,2,3,4'"),
    ("mkdaemon detect text.png --camera none.toml", "camera file none.toml"),
    ("mkdaemon detect text.png --target none.toml", "target file none.toml"),
    ("mkdaemon detect text.png --tag-size 300", "is not a tag size"),
    ("mkdaemon detect text.png --tag-size 0.1 --target t.toml", "not both"),
    ("mkdaemon detect text.png --ids a-b", "--ids 'a-b'"),
    ("mkdaemon detect text.png --ids 5-1", "5-1 counts down"),
    ("mkdaemon detect text.png --family tag99", "tag family 'tag99' is not known"),
    ("mkdaemon calibrate camera", "give a folder of pictures, or --source"),
    ("mkdaemon calibrate camera nowhere --board chess", "--board 'chess'"),
    ("mkdaemon calibrate camera --source webcam", "source 'webcam'"),
    ("mkdaemon calibrate print x.svg", "give one of --target, --tag, --charuco"),
    ("mkdaemon calibrate print x.svg --tag 7:0.1 --charuco 9x6", "not --tag and --charuco"),
    ("mkdaemon calibrate print x.svg --tag 7", "--tag '7'"),
    ("mkdaemon calibrate print x.svg --tag 7:90", "--tag '7:90'"),
    ("mkdaemon calibrate print x.svg --tag 999:0.1", "has no id 999"),
    ("mkdaemon calibrate print x.svg --charuco nine", "--charuco 'nine'"),
    ("mkdaemon calibrate print x.svg --charuco 2x2", "at least 3x3"),
    ("mkdaemon calibrate print x.svg --target none.toml", "target file none.toml"),
    ("mkdaemon calibrate print x.svg --tag 7:0.1 --tile a4", "tiles on 'a4' in x.svg"),
    (SURVEY.format("target.mcap --size 0.3"), "the images are 144x108"),
    (SURVEY.format("sticks.mcap --size 0.3"), "record.images.hz"),
    (SURVEY.format("gone.mcap --size 0.3"), "no such recording, video, picture or folder: gone.mcap"),
    (SURVEY.format("configs/sim.toml --size 9"), "9.0 is not a tag size"),
    (SURVEY.format("configs --size 0.3"), "no pictures in"),
    (SURVEY.format("configs --size 0.3 --family tag99"), "tag99"),
    (SURVEY.format("configs --size 0.3 --sizes a=1"), "--sizes 'a=1': give ID=SIZE"),
    (SURVEY.format("configs --size 0.3 --sizes 1=1.2.3"), "'1.2.3' is no length in metres"),
    (SURVEY.format("configs --size 0.3 --place Pad=3"), "--place 'Pad=3': give NAME=ID, each name once"),
    (SURVEY.format("configs --size 0.3 --distance 1:1=2"), "--distance '1:1=2': give ID:ID=DISTANCE"),
    ("mkdaemon gateway foxglove --port 70000", "--port 70000: give one from 1 to 65535, or 0 for any that is free"),
    ("mkdaemon gateway foxglove --vehicle Über", "--vehicle 'Über': a name has lower-case letters"),
    ("mkctl log export text.png", "no recording of mkdaemon"),
    ("mkctl log export flight.mcap -f gpx -o no/folder/a.gpx", "there is no folder"),
    ("mkctl log export flight.mcap -f pdf", "pdf"),
    ("mkctl log report flight.mcap --vehicle mk9", "no values of vehicle mk9"),
    ("mkctl log report flight.mcap -o nowhere/page.html", "there is no folder"),
    ("mkctl log info", "give one recording or more"),
    ("mkctl log list nowhere", "nowhere: there is no such folder"),
    ("mkctl log cut flight.mcap -o x.mcap --from noon", "--from 'noon'"),
    ("mkctl log cut flight.mcap -o x.mcap --from nan", "--from 'nan'"),
    ("mkctl log cut flight.mcap -o nowhere/x.mcap", "there is no folder"),
    ("mkctl log play flight.mcap --speed 0", "--speed 0: give a number above 0"),
    ("mkctl log play flight.mcap --as mk1/setpoint", "--as 'mk1/setpoint': a name has lower-case letters"),
    ("mkctl log play flight.mcap --from soon", "--from 'soon'"),
    ("mkctl log record --total-mb 0", "--total-mb 0: give 1 or more"),
    ("mkctl log record --seconds -1", "--seconds -1: give a number above 0"),
    ("mkctl view --no-browser --port 70000", "--port 70000: give one from 1 to 65535"),
    ("mkctl view --no-browser flight.mcap --speed 0", "--speed 0: give a number above 0"),
    ("mkctl linktest --control 101", "--control 101: give a rate from 0 to 100 Hz"),
    ("mkctl stick --throttle 0 --pitch 300", "--pitch 300: give a number from -127 to 127"),
    ("mkctl stick --throttle nan", "--throttle nan: give a number"),
    ("mkctl stick --throttle 0 --rate 0", "--rate 0: give a number above 0"),
    ("mkctl goto nan 0 2 --frame home --confirm", "X nan: give a number"),
    ("mkctl goto 10 0 2 --frame home" + NOWHERE, "repeat with --confirm"),
    ("mkctl waypoints fly" + NOWHERE, "repeat with --confirm"),
    ("mkctl waypoints home" + NOWHERE, "repeat with --confirm"),
    ("mkctl waypoints home --confirm --patience 0", "--patience 0: give a number above 0"),
    ("mkctl get --vehicle '*'", "--vehicle '*': a name has lower-case letters, digits, - and _"),
    ("mkctl status --vehicle a/b", "--vehicle 'a/b': a name has lower-case letters, digits, - and _"),
    ("mkctl status --connect here", "'here' is not a Zenoh endpoint; write it like tcp/127.0.0.1:7447"),
    ("mkctl status --zenoh-file no.json5", "no.json5: no usable Zenoh configuration"),
    ("mkctl watch --count 0", "--count 0: give 1 or more"),
    ("mkctl watch --seconds nan", "--seconds nan: give a number above 0"),
    ("mkctl teleop --keyboard --joy far", "--keyboard and --joy do not go together"),
    ("mkctl teleop --joy far --replay x", "--joy and --replay do not go together"),
    ("mkctl teleop --keyboard", "--keyboard needs a terminal"),
    ("mkctl teleop --joy 'Far Away'", "lower-case"),
    ("mkctl teleop --publish a/b", "lower-case"),
    ("mkctl teleop --publish far", "MK_JOY_SECRET"),
    ("mkctl teleop --replay none.jsonl", "none.jsonl: cannot be read"),
    ("mkctl teleop --mapping none.toml", "none.toml: no such configuration file"),
    ("mkctl teleop --joy far --record text.png", "text.png: File exists"),
]
FAILURE = [
    ("mkdaemon detect text.png", "text.png: no picture that can be read"),
    ("mkdaemon detect clip.mp4", "clip.mp4: no video that can be read"),
    ("mkdaemon calibrate camera nowhere", "no such folder: nowhere"),
    ("mkdaemon decode absent", "cannot read absent"),
    ("mkdaemon decode empty", "Is a directory"),
    ("mkdaemon decode nothing", "nothing is empty: nothing was recorded"),
    ("mkdaemon decode damaged.jsonl", "line 2 is no capture line"),
    ("mkctl log export missing.mcap", "missing.mcap: cannot be opened"),
    ("mkctl log export flight.mcap -k nothing/*", "nothing to export"),
    ("mkctl log export flight.mcap -f gpx -k state/battery", "no state/position"),
    ("mkctl log export flight.mcap -f ros -k link/traffic", "nothing in the recording has a message of ROS"),
    ("mkctl log report missing.mcap", "missing.mcap: cannot be opened"),
    ("mkctl log report text.png", "nothing to report"),
    ("mkctl log info missing.mcap", "missing.mcap: cannot be opened"),
    ("mkctl log verify missing.mcap", "missing.mcap: cannot be opened"),
    ("mkctl log repair missing.mcap", "missing.mcap: cannot be opened"),
    ("mkctl log play flight.mcap -k setpoint/*", "nothing to play"),
    ("mkctl view --no-browser missing.mcap", "missing.mcap: cannot be opened"),
]
MISTAKES = [
    (words, code, told) for code, rows in ((EXIT_CONFIG, CONFIG), (EXIT_FAILURE, FAILURE)) for words, told in rows
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Files that are none, recordings, configurations."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "nothing").touch()
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "clip.mp4").write_text("no video")
    (tmp_path / "damaged.jsonl").write_text('{"t": 0, "dir": "rx", "hex": "2362764078"}\n{"t": 0}\n')
    save_camera(Camera(intrinsics=BUILT_IN.intrinsics), tmp_path / "lens.toml")
    (tmp_path / "configs").symlink_to(CONFIGS)
    for name, of in (("flight", "nc_lost_client"), ("target", "fc_over_target"), ("sticks", "fc_sticks")):
        (tmp_path / f"{name}.mcap").symlink_to(DATA / "recordings" / f"{of}.mcap")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MK_JOY_SECRET", raising=False)
    return tmp_path


@pytest.mark.parametrize(("words", "code", "told"), MISTAKES)
def test_a_mistake_is_one_line_and_leaves_nothing(folder, words, code, told, capsys):
    before = sorted(folder.iterdir())
    program, *tokens = shlex.split(words)
    assert run(PROGRAMS[program], tokens) == code
    err = capsys.readouterr().err
    assert re.match(f"{program}: ", err) and told in err, err
    assert len(err.splitlines()) == 1
    assert sorted(folder.iterdir()) == before
