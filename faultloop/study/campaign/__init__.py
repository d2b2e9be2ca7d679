"""Campaigns: many cases of one scenario, each with its verdict, in one Parquet file.

>>> campaign = faultloop.Campaign.load("campaigns/position-and-sir.toml")
>>> campaign.run(out="position.parquet", workers=2).wrong
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from faultloop.config.campaign import CampaignTables
from faultloop.config.tables import read_toml, validate
from faultloop.errors import InputError
from faultloop.study.campaign.check import check_plan
from faultloop.study.campaign.plan import Case, Files, Plan
from faultloop.study.campaign.summary import Progress, Summary


class Campaign:
    """A campaign that can be run.  Build it from a file (`load`) or a dict (`from_dict`)."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @classmethod
    def load(cls, path: Path | str, *, user_code: bool = True) -> Campaign:
        """Of a file.  Raises InputError."""
        data, _ = read_toml(path)
        return cls.from_dict(data, path=Path(path), user_code=user_code)

    @classmethod
    def from_dict(
        cls, data: Mapping[str, Any], *, path: Path | None = None, user_code: bool = True
    ) -> Campaign:
        """Validated.  Raises InputError.

        Parameters
        ----------
        data : what a campaign file says.
        path : the file that the scenario's path is relative to; the working folder where not given.
        user_code : whether the relays' settings may name code.
        """
        tables = validate(CampaignTables, data, path)
        base = path.parent if path is not None else Path()
        plan = Plan(tables, Files.read(base / tables.campaign.scenario), path, user_code)
        check_plan(plan)
        if plan.key_files():
            from faultloop.nodes.roster import seal

            seal(plan.first.scenario)  # in one line here, not in each row
        return cls(plan)

    @property
    def cases(self) -> int:
        """How many there are."""
        return self.plan.cases

    def case(self, number: int) -> Case:
        """One of them, from 0: its values, scenario and settings.  InputError where it is impossible."""
        if not 0 <= number < self.cases:
            raise InputError(f"there is no case {number}; they are 0 to {self.cases - 1}", key="case")
        return self.plan.case(number)

    def run(
        self,
        out: Path | str,
        *,
        workers: int = 1,
        scheduler: str | None = None,
        keep: Sequence[str] = (),
        float64: bool = False,
        progress: Progress | None = None,
    ) -> Summary:
        """Run the cases that are not there yet, to one Parquet file.

        Parameters
        ----------
        out : the file, whole at the end; until then finished parts lie in ``OUT.parts``.
        workers : processes; 1 runs in this one.  The rows are the same whatever their number.
        scheduler : address of a dask.distributed cluster, which then does the work.
        keep : of ``samples``, ``phasors``, ``loops``: each case's waves, in ``OUT`` with suffix ``.waves``.
        float64 : keep them in double precision.
        progress : called with the number of cases done, and of all.

        Raises
        ------
        InputError : `out` cannot be written or is of another campaign, or a worker died.
        """
        from faultloop.study.campaign.run import run_campaign
        from faultloop.study.campaign.waves import Waves

        if float64 and not keep:
            raise InputError("says how waves are kept: it needs --keep", key="--float64")
        waves = Waves(self.plan, keep, float64) if keep else None
        return run_campaign(self.plan, Path(out), workers, progress, waves, scheduler)


__all__ = ["Campaign", "Case", "Summary"]
