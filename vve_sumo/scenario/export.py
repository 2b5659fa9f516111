"""What a scenario file may say as a JSON Schema, for editors that complete and check while one types.

Knows the models alone. What only loading tells (names of files, ids that stand twice) is not in it.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from vve_sumo.scenario.schema import Scenario


class _Toml(GenerateJsonSchema):
    """Pydantic's generator for a language that has no null: a key that has no value is left out."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        # The keys of a table that is left out have defaults of their own.
        if schema.get("default") is None or isinstance(schema["default"], BaseModel):
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)

    def field_title_should_be_set(self, schema: object) -> bool:
        """Leave out titles made from the keys' own names: editors show the key as it is."""
        return False

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        # Keys that do not match their pattern are errors, which pydantic does not say.
        made = super().dict_schema(schema)
        return made | {"additionalProperties": False} if "patternProperties" in made else made


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a scenario file."""
    made = Scenario.model_json_schema(schema_generator=_Toml)
    return {"$schema": _Toml.schema_dialect, **made, "title": "vve_sumo scenario"}
