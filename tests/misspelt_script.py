# SPDX-License-Identifier: Apache-2.0
"""Misspelt names of sources, candidate models, tables and limits, for mypy alone: each is an error,
since mypy also refuses a `type: ignore` that ignores nothing."""

from osl_analysis.inference.candidate_models import CandidateModel
from osl_analysis.inference.model_names import ModelName
from osl_analysis.ingest.guard import POSSIBLE
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.rules import Beyond, NumberRule, Table
from osl_analysis.stats.budget import Contribution, Verdict
from osl_analysis.stats.sources import Source

Contribution("torque_paht", 1.0)  # type: ignore[arg-type]
Contribution(Source.TORQUE_PAHT, 1.0)  # type: ignore[attr-defined]
Finding("torque_paht")  # type: ignore[arg-type]
Finding(Source.TORQUE_PAHT)  # type: ignore[attr-defined]
Beyond("K", 1.0, 0.5, "torque_paht")  # type: ignore[arg-type]
Verdict("torque_paht", 0.5)  # type: ignore[arg-type]
Verdict("claer", 0.5)  # type: ignore[arg-type]
CandidateModel("speed", "backlahs")  # type: ignore[arg-type]
CandidateModel("sped", ModelName.BACKLASH)  # type: ignore[arg-type]
CandidateModel("speed", ModelName.BACKLAHS)  # type: ignore[attr-defined]
NumberRule("too_stiff", "unlikely", tables=(), column="K", limit=None)  # type: ignore[arg-type]
NumberRule(
    "too_stiff",
    Source.UNLIKELY_SIZE,
    tables=(Table.IMPEDANSE,),  # type: ignore[attr-defined]
    column="K",
    limit=None,
)
print(POSSIBLE.shortest_stpe_s)  # type: ignore[attr-defined]
