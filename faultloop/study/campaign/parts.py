"""The finished parts of a campaign beside its file, and the file that they become."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from faultloop.errors import InputError
from faultloop.io.output_file import write_aside

LEAST_PARTS, MOST_IN_A_PART = 64, 1000
ROW_GROUP = 65_536
KEY = b"faultloop"


class Parts:
    """The folder ``F.parquet.parts``, held by one campaign at a time.  InputError where it is another's."""

    def __init__(self, out: Path, cases: int, fingerprint: str, most: int | None = None) -> None:
        self.out, self.cases = out, cases
        self.folder = Path(f"{out}.parts")
        self.size = min(max(cases // LEAST_PARTS, 1), MOST_IN_A_PART if most is None else most)
        self.count = -(-cases // self.size)
        if out.suffix.lower() != ".parquet":
            raise InputError("must end in .parquet", file=out)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._owner = (self.folder / "campaign.json").open("a+", encoding="utf-8")
            self._own(fingerprint)
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror or error})", file=self.folder) from None

    def _own(self, fingerprint: str) -> None:
        _lock(self._owner, self.out)
        self._owner.seek(0)
        text = self._owner.read()
        wanted = json.dumps({"fingerprint": fingerprint, "cases": self.cases})
        if text and text != wanted:
            self._owner.close()
            raise InputError(
                "holds parts of another campaign, or of one that was changed since; give another --out, or"
                " delete the folder",
                file=self.folder,
            )
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
        try:
            return pq.read_metadata(self.path(self.folder, number)).num_rows == self.size_of(number)
        except (OSError, pa.ArrowException):
            return False

    @staticmethod
    def path(folder: Path, number: int) -> Path:
        return folder / f"part-{number:06d}.parquet"

    @classmethod
    def write(cls, folder: Path, number: int, table: pa.Table, **options: Any) -> None:
        """A part, whole or not at all."""
        path = cls.path(folder, number)
        try:
            with write_aside(path) as aside:
                pq.write_table(table, aside, compression="zstd", **options)
        except InputError as error:
            raise InputError(
                f"{error.what}; the parts before it are kept in {folder}, and the same command goes on from"
                " there",
                file=path,
            ) from None

    def merge(self, schema: pa.Schema, record: Mapping[str, Any]) -> None:
        """The whole file from its parts, which are then removed."""
        whole = schema.with_metadata({KEY: json.dumps(record).encode()})
        try:
            with (
                write_aside(self.out) as aside,
                pq.ParquetWriter(aside, whole, compression="zstd") as writer,
            ):
                for table in self._row_groups():
                    writer.write_table(table.replace_schema_metadata(whole.metadata))
        except InputError as error:
            raise InputError(f"{error.what}; {self.kept()}", file=self.out) from None
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _row_groups(self) -> Iterator[pa.Table]:
        """Of a size of their own, so that nothing tells how the parts were."""
        held: list[pa.Table] = []
        for number in range(self.count):
            held.append(pq.read_table(self.path(self.folder, number)))
            if sum(map(len, held)) >= ROW_GROUP:
                table = pa.concat_tables(held).combine_chunks()
                yield table.slice(0, ROW_GROUP).combine_chunks()
                held = [table.slice(ROW_GROUP)]
        rest = pa.concat_tables(held).combine_chunks()
        if len(rest):
            yield rest


def finished(out: Path, fingerprint: str) -> bool:
    """Whether the file is there and this campaign's.  Raises InputError where it is something else."""
    if not out.exists():
        return False
    if read_record(out).get("fingerprint") != fingerprint:
        raise InputError(
            "is of another campaign, or of one that was changed since; give another --out, or delete it",
            file=out,
        )
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
