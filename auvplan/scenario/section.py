"""What all sections of a scenario are made of."""

from typing import Any, ClassVar, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator


def setting(default: Any, description: str) -> Any:
    """Return a field of a section: its default, and what it is."""
    return Field(default=default, description=description)


def optional(description: str) -> Any:
    """Return a field that may be absent, and is None then."""
    return setting(None, description)


class Section(BaseModel):
    """Base of all sections: unknown keys are faults, values do not change."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)

    def stated(self, *apart: str) -> dict[str, Any]:
        """Return the fields that are given, but for some."""
        fields = {name: getattr(self, name) for name in type(self).model_fields if name not in apart}
        return {name: value for name, value in fields.items() if value is not None}

    def _check(self) -> None:
        """Refuse values that do not go together, by a `ValueError`; a `RuleError` names the fields."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self._check()
        return self

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth(cls, given: Any, info: ValidationInfo) -> Any:
        """Refuse true and false, for which YAML takes yes, no, on and off too, where a number is wanted."""
        annotation = cls.model_fields[info.field_name or ""].annotation
        if bool not in (annotation, *get_args(annotation)):
            for entry in given if isinstance(given, list) else [given]:
                if isinstance(entry, bool):
                    shown = str(entry).lower()
                    raise ValueError(f"must not be true or false (nor yes, no, on, off), got {shown}")
        return given
