"""Writes an export: where its files go, and that none replaces a file that is there.

Must not know what any format holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.formats import FORMATS, Format
from vve_sumo.export.part import ExportPart


def export(source: Run | Sweep, name: str, out: Path | str | None = None) -> list[Path]:
    """Write a drive or a sweep in a format of FORMATS; return the files, the one that was asked for first.

    `out` is a file that does not exist yet, or a folder that does; by default it is the working folder, and the file is
    named after the record's or the sweep's folder. Raises ConfigError, before anything is written, for a format that is
    unknown, not installed or none for a sweep, and for files that exist.
    """
    return export_all(source, [name], out)[name]


def export_all(source: Run | Sweep, names: Sequence[str], out: Path | str | None = None) -> dict[str, list[Path]]:
    """Write a drive or a sweep in several formats, all of them or none; return the files of each, as `export` does.

    Raises ConfigError as `export` does, and for several formats where `out` is one file.
    """
    unknown = next((name for name in names if name not in FORMATS), None)
    if unknown is not None:
        raise ConfigError(f"no format {unknown!r} to export to; there are {', '.join(FORMATS)}")
    place = Path("." if out is None else out)
    if len(names) > 1 and not place.is_dir():
        raise ConfigError(f"--out: {place} is no folder, and {len(names)} formats make several files")
    written: dict[str, list[Path]] = {}
    contents: dict[Path, bytes] = {}
    for name in names:
        form = FORMATS[name]
        file = _place(source.folder, form, place)
        parts = [*_parts(source, form)]
        written[name] = [_named(file, part) for part in parts]
        contents |= zip(written[name], (part.content for part in parts), strict=True)
    taken = next((file for file in contents if file.exists()), None)
    if taken is not None:
        raise ConfigError(f"{taken}: there already; choose another place with --out")
    _write(contents)
    return written


def _parts(source: Run | Sweep, form: Format) -> list[ExportPart]:
    if isinstance(source, Run):
        return [*form.of_drive(source)]
    if form.of_sweep is None:
        records = source.folder / "records" / "KEY"
        raise ConfigError(
            f"{source.folder}: a sweep's folder; {form.name} is of one drive: a record, such as {records}"
        )
    return [*form.of_sweep(source)]


def _place(folder: Path, form: Format, out: Path) -> Path:
    """Return the file that an export is to be written to."""
    file = out / f"{folder.resolve().name}{form.ending}" if out.is_dir() else out
    if not file.parent.is_dir():
        raise ConfigError(f"{file.parent}: no such folder for {file.name}")
    return file


def _named(file: Path, part: ExportPart) -> Path:
    stem = f"{part.head}_{file.stem}" if part.head else file.stem
    return file.with_name(f"{stem}.{part.name}{file.suffix}" if part.name else f"{stem}{file.suffix}")


def _write(contents: Mapping[Path, bytes]) -> None:
    """Write files, all of them or none."""
    begun: list[Path] = []
    try:
        for file, content in contents.items():
            with file.open("xb") as sink:
                begun.append(file)
                sink.write(content)
    except OSError:
        for file in begun:
            file.unlink(missing_ok=True)
        raise
