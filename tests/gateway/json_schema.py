"""JSON Schemas in tests: each is checked once, however many messages are held against it."""

import json
from functools import cache
from typing import Any

from jsonschema.protocols import Validator
from jsonschema.validators import validator_for


@cache
def validator_of(schema: bytes | str) -> Validator:
    """What judges messages by a schema that is itself valid: `.validate(message)` or an error."""
    definition: Any = json.loads(schema)
    kind = validator_for(definition)
    kind.check_schema(definition)
    return kind(definition)
