"""The finished parts of a campaign beside its file, and the file that they become."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from glob import escape
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from faultloop.errors import InputError
from faultloop.io.output_file import write_aside

LEAST_PARTS, MOST_IN_A_PART = 64, 1000
FEWEST_PARTS = 8
"""However short the cases are."""
ROW_GROUP = 65_536
KEY, OWNER = b"faultloop", "campaign.json"
OTHERS = "of another campaign, or of one that was changed since; give another --out, or delete"


class PartFiles(NamedTuple):
    """Where parts lie, for the process that makes them.

    Attributes
    ----------
    folder : of their rows.
    waves : of their waves; None where none are kept.
    mark : of the campaign, in every file of waves.
    """

    folder: Path
    waves: Path | None
    mark: str

    def write(self, number: int, rows: pa.Table, waves: pa.Table | None) -> None:
        """A part, whole or not at all.  The waves first: where the rows are, the waves are."""
        if self.waves is not None and waves is not None:
            marked = waves.replace_schema_metadata({KEY: self.mark})
            floats = [field.name for field in waves.schema if hasattr(field.type, "value_type")]  # lists
            self._write(self.waves, number, marked, use_byte_stream_split=floats, use_dictionary=False)
        self._write(self.folder, number, rows)

    def _write(self, folder: Path, number: int, table: pa.Table, **options: Any) -> None:
        path = part_path(folder, number)
        try:
            with write_aside(path) as aside:
                pq.write_table(table, aside, compression="zstd", **options)
        except InputError as error:
            raise InputError(
                f"{error.what}; the parts before it are kept in {self.folder}, and the same command goes on"
                " from there",
                file=path,
            ) from None


class Parts:
    """The folder ``F.parquet.parts``, held by one campaign at a time.  InputError where it is another's.

    Parameters
    ----------
    fingerprint : of the campaign and of what is kept of it.
    least, most : cases in a part, where there are enough, and at most.
    waves : the folder of the parts' waves, where these are kept.
    """

    def __init__(
        self,
        out: Path,
        cases: int,
        fingerprint: str,
        most: int | None = None,
        waves: Path | None = None,
        least: int = 1,
    ) -> None:
        self.out, self.cases = out, cases
        self.files = PartFiles(folder_of(out), waves, fingerprint)
        self.folder = self.files.folder
        size = max(cases // LEAST_PARTS, min(least, cases // FEWEST_PARTS), 1)
        self.size = min(size, MOST_IN_A_PART if most is None else most)
        self.count = -(-cases // self.size)
        if out.suffix.lower() != ".parquet":
            raise InputError("must end in .parquet", file=out)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._owner = (self.folder / OWNER).open("a+", encoding="utf-8")
            self._own(fingerprint)
            _sweep(self.folder, "part-*")
            _sweep(out.parent, escape(out.name))
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror or error})", file=self.folder) from None

    def _own(self, fingerprint: str) -> None:
        _lock(self._owner, self.out)
        self._owner.seek(0)
        text = self._owner.read()
        wanted = json.dumps({"fingerprint": fingerprint, "cases": self.cases})
        if text and text != wanted:
            self._owner.close()
            raise InputError(f"holds parts {OTHERS} the folder", file=self.folder)
        if not text:
            self._owner.write(wanted)
            self._owner.flush()

    def close(self) -> None:
        """Leave it to another campaign."""
        self._owner.close()

    def size_of(self, number: int) -> int:
        """Cases in a part."""
        return min(self.size, self.cases - number * self.size)

    def missing(self) -> list[int]:
        """Numbers of the parts that are not there, whole."""
        return [number for number in range(self.count) if not self._whole(number)]

    def kept(self) -> str:
        """For a person: how far it came."""
        cases = sum(self.size_of(number) for number in range(self.count) if self._whole(number))
        return f"{cases} of {self.cases} cases are kept in {self.folder}"

    def _whole(self, number: int) -> bool:
        folders = [self.folder] if self.files.waves is None else [self.folder, self.files.waves]
        return all(_rows(part_path(folder, number)) == self.size_of(number) for folder in folders)

    def merge(self, schema: pa.Schema, record: Mapping[str, Any]) -> None:
        """The whole file from its parts, which are then removed."""
        whole = schema.with_metadata({KEY: json.dumps(record).encode()})
        try:
            with write_aside(self.out) as aside:
                with pq.ParquetWriter(aside, whole, compression="zstd") as writer:
                    for table in self._row_groups():
                        writer.write_table(table.replace_schema_metadata(whole.metadata))
                _to_the_disk(aside)  # before the parts are removed
        except InputError as error:
            raise InputError(f"{error.what}; {self.kept()}", file=error.file or self.out) from None
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _row_groups(self) -> Iterator[pa.Table]:
        """Of a size of their own, so that nothing tells how the parts were."""
        held: list[pa.Table] = []
        for number in range(self.count):
            held.append(self._read(number))
            if sum(map(len, held)) >= ROW_GROUP:
                table = pa.concat_tables(held).combine_chunks()
                yield table.slice(0, ROW_GROUP).combine_chunks()
                held = [table.slice(ROW_GROUP).combine_chunks()]
        rest = pa.concat_tables(held).combine_chunks()
        if len(rest):
            yield rest

    def _read(self, number: int) -> pa.Table:
        path = part_path(self.folder, number)
        try:
            with pq.ParquetFile(path) as file:  # read_table takes 4 ms to begin
                return file.read(use_threads=False)
        except (OSError, pa.ArrowException):
            raise InputError(
                "is damaged; delete it, and the same command makes it again", file=path
            ) from None


def folder_of(out: Path) -> Path:
    """Where the parts of a campaign's file are while it is made."""
    return Path(f"{out}.parts")


def part_path(folder: Path, number: int) -> Path:
    """A part's rows, or its waves."""
    return folder / f"part-{number:06d}.parquet"


def prepare_waves(folder: Path, mark: str, card: str) -> None:
    """The folder of a campaign's waves, and the data card beside it: in it are Parquet files alone.

    Raises InputError where it has waves of another campaign, or cannot be written.
    """
    try:
        folder.mkdir(exist_ok=True)
        _sweep(folder, "part-*")
        if any(_mark(part) not in (mark, None) for part in folder.glob("part-*.parquet")):
            raise InputError(f"holds waves {OTHERS} the folder", file=folder)
        folder.with_suffix(".waves.md").write_text(card, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", file=folder) from None


def waves_there(folder: Path, mark: str) -> int:
    """Of how many cases of this campaign the waves are there."""
    return sum(_rows(part) or 0 for part in folder.glob("part-*.parquet") if _mark(part) == mark)


def finished(out: Path, fingerprint: str) -> bool:
    """Whether the file is there and this campaign's; parts of it that a kill has left are removed.

    Raises InputError where it is something else.
    """
    if not out.exists():
        return False
    if read_record(out).get("fingerprint") != fingerprint:
        raise InputError(f"is {OTHERS} it", file=out)
    folder = folder_of(out)
    if _owned_by(folder).startswith(fingerprint):
        shutil.rmtree(folder, ignore_errors=True)
    return True


def read_record(path: Path) -> dict[str, Any]:
    """What a campaign's file tells of itself.  Raises InputError where it is not one."""
    from faultloop.config.input_file import check_input

    check_input(path, "a campaign's Parquet file")
    try:
        metadata = pq.read_schema(path).metadata or {}
        record = json.loads(metadata[KEY])
    except (OSError, pa.ArrowException, ValueError) as error:
        raise InputError(f"is not a Parquet file ({' '.join(str(error).split())[:80]})", file=path) from None
    except KeyError:
        raise InputError("is a Parquet file, but not of a campaign", file=path) from None
    if not isinstance(record, dict):
        raise InputError("is a Parquet file, but not of a campaign", file=path)
    return record


def _owned_by(folder: Path) -> str:
    try:
        return str(json.loads((folder / OWNER).read_text(encoding="utf-8"))["fingerprint"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _rows(part: Path) -> int | None:
    try:
        return pq.read_metadata(part).num_rows
    except (OSError, pa.ArrowException):
        return None


def _mark(part: Path) -> str | None:
    """Whose waves they are; None where they are not whole."""
    try:
        return (pq.read_schema(part).metadata or {}).get(KEY, b"").decode()
    except (OSError, pa.ArrowException):
        return None


def _sweep(folder: Path, name: str) -> None:
    """Away with files in the making that a campaign that was killed has left."""
    for stray in folder.glob(f"{name}.*.tmp"):
        stray.unlink(missing_ok=True)


def _to_the_disk(path: Path) -> None:
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _lock(file: Any, out: Path) -> None:
    """The system gives it back when the process ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise InputError("another campaign is writing to it", file=out) from None
