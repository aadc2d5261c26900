"""The paper's simulation study (section 4) over again: its figures, and its claims judged."""

from auvplan.paper.claims import Claim, Evidence, as_json, as_markdown, judge
from auvplan.paper.reproduce import Effort, reproduce

__all__ = ["Claim", "Effort", "Evidence", "as_json", "as_markdown", "judge", "reproduce"]
