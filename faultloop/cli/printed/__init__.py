"""What commands print with ``--json``: a type for each, from which its published schema is made.

Keys may be added, never taken away or renamed.  Times ``*_s`` and ``*_ns`` count from the start of the run,
``*_ms`` from the fault's inception where nothing else is said.  A number that is none (NaN) is null.
"""

from __future__ import annotations

from typing import Any

from faultloop.cli.printed import files, records, runs, studies
from faultloop.review.why import Reason
from faultloop.study.campaign.summary import Summary

PRINTED: dict[str, Any] = {
    "run": runs.Run,
    "replay": runs.Replay,
    "channels": records.RecordChannels | records.LogChannels,
    "check": files.ScenarioCheck | files.SettingsCheck | files.CampaignCheck,
    "review": files.Review,
    "why": list[Reason],
    "why-at": list[files.Instant],
    "locate": files.Locate,
    "diff": files.Diff,
    "export": files.Export,
    "recover": files.Recover,
    "import": files.Import,
    "monitor": files.Monitor,
    "suite": studies.Suite,
    "campaign-summary": Summary,
    "campaign-report": studies.CampaignReport,
    "campaign-case": studies.CampaignCase,
}
"""By its name in ``faultloop schema``: the command's, but ``campaign-summary`` is what ``campaign`` prints
(that name is the file's) and ``why-at`` what ``why --at`` does."""
