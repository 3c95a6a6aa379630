"""What everything that is read from files inherits: frozen, finite, no unknown fields."""

from pydantic import BaseModel, ConfigDict


class Frozen(BaseModel):
    """Base of immutable, validated values; unknown fields, infinities and NaN are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
