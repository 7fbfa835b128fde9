"""Which crossings have a result of their own: the configuration's choices of groups."""

from typing import Literal, Self

from pydantic import model_validator

from osl_analysis.yaml_settings import Positive, Settings

PoolKey = Literal["group", "subject", "session", "side", "speed", "K_d", "B_d", "timing"]
GroupKey = PoolKey | Literal["direction"]


class GroupSettings(Settings):
    """Which crossings have a result of their own."""

    group_by: tuple[GroupKey, ...] = ()
    """Conditions by which results are always split. A campaign that differs in another condition is split by it too,
    unless `pool` names it. Opposite directions are joined by half their difference, unless they are named here."""
    pool: tuple[PoolKey, ...] = ()
    """Conditions in which crossings of one result may differ."""
    timing_scatter: Positive = 0.05
    """Largest SD of the onset's phase, as a share of stance, of one timing."""

    @model_validator(mode="after")
    def _split_or_pooled(self) -> Self:
        both = sorted(set(self.group_by) & set(self.pool))
        if both:
            raise ValueError(f"'{both[0]}' stands in group_by and in pool; remove it from one of them")
        return self
