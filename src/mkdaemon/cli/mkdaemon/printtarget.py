"""`mkdaemon calibrate print`: print tags, nested targets and calibration boards in true size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.printing import show
from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.errors import ConfigError
from mkdaemon.files import refuse_existing, save
from mkdaemon.vision.calibrate.board import CharucoBoard
from mkdaemon.vision.calibrate.target_print import Page, board_page, target_page, write_page
from mkdaemon.vision.tags.tagmap import Target, build
from mkdaemon.vision.tags.targetfile import as_toml, load


def print_target(
    output: Annotated[Path, Parameter(help="File to write, .svg or .pdf.")],
    /,
    *,
    target: Annotated[Path | None, Parameter(help="Target file, for example configs/targets/nested.toml.")] = None,
    tag: Annotated[
        tuple[str, ...],
        Parameter(
            help="Tag as ID:SIZE or FAMILY/ID:SIZE, side of the black square [m]; a second one is nested inside.",
        ),
    ] = (),
    charuco: Annotated[str | None, Parameter(help="Calibration board COLUMNSxROWS, for example 9x6.")] = None,
    square: Annotated[float, Parameter(help="Side of a square of the calibration board [m].")] = 0.03,
    tile: Annotated[str | None, Parameter(help="Cut a PDF for this paper: a4, a3, a2, a1 or a0.")] = None,
    write_target: Annotated[Path | None, Parameter(help="Also write a target file of the given tags.")] = None,
    force: Annotated[bool, Parameter(help="Overwrite existing files.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write a target or calibration board as SVG or PDF in true size, with a ruler to check the print.

    Examples:
        mkdaemon calibrate print pad.pdf --target configs/targets/nested.toml
        mkdaemon calibrate print tag.svg --tag 7:0.16
        mkdaemon calibrate print board.pdf --charuco 9x6 --square 0.028

    Raises:
        ConfigError: not one target was given, it cannot be drawn, or a file is there already.
        MkError: a file cannot be written.
    """
    for path in (output, write_target):
        if path is not None:
            refuse_existing(path, overwrite=force)
    given = [name for name, value in (("--target", target), ("--tag", tag), ("--charuco", charuco)) if value]
    if len(given) != 1:
        raise ConfigError(f"give one of --target, --tag, --charuco{', not ' + ' and '.join(given) if given else ''}")
    if charuco is not None:
        page = board_page(_board(charuco, square))
    else:
        chosen = target_of(target) if target is not None else _from_tags(tag)
        page = target_page(chosen)
        if write_target is not None:
            _write_target_file(chosen, write_target, overwrite=force)
    write_page(page, output, tile=tile, overwrite=force)
    _print_page(page, output, as_json=as_json)


def _print_page(page: Page, output: Path, *, as_json: bool) -> None:
    size = {"width_mm": round(page.width, 3), "height_mm": round(page.height, 3)}
    words = f"{output}: {page.width:.1f} x {page.height:.1f} mm, {page.title}"
    words += "\nPrint at 100 %, then measure the ruler: it must be 100 mm."
    show({"file": output, **size, "title": page.title}, words, as_json=as_json)


def _board(text: str, square: float) -> CharucoBoard:
    columns, by, rows = text.lower().partition("x")
    if not (by and columns.isdigit() and rows.isdigit()):
        raise ConfigError(f"--charuco '{text}': give COLUMNSxROWS, for example 9x6")
    return CharucoBoard(int(columns), int(rows), square)


def target_of(path: Path) -> Target:
    """The one target of a file.

    Raises:
        ConfigError: the file cannot be used, or holds several.
    """
    targets = load([path]).targets
    if len(targets) > 1:
        raise ConfigError(f"target file {path} holds {len(targets)} targets: keep the one that is printed")
    return targets[0]


def _from_tags(tags: tuple[str, ...]) -> Target:
    placements = []
    for text in tags:
        name, _, size = text.partition(":")
        family, slash, number = name.rpartition("/")
        try:
            placements.append(TagPlacement(family=family if slash else "tag36h11", id=int(number), size=float(size)))
        except ValueError:
            msg = f"--tag '{text}': give ID:SIZE in metres (0.005 to 5), for example 7:0.16 or tag25h9/3:0.1"
            raise ConfigError(msg) from None
    return build([TargetSection(name="print", tags=tuple(placements))], origin="--tag").targets[0]


def _write_target_file(target: Target, path: Path, *, overwrite: bool) -> None:
    named = replace(target, name=path.stem.lower())
    save(path, as_toml(named, "Sizes as designed: measure the print and correct them."), overwrite=overwrite)
