"""The options that define a baked value, as JSON that travels with the texture.

    {"schema": 1, "only": [], ..., "two_sided": true, "ground": true, "up": "y", "estimator": "ratio", ...}

The text is in the picture where its format holds one (see `images`), the object in the `extras` of glTF's
occlusionTexture, as the member "aoprecalc". Neither has paths, times or names of machines. What is read is not trusted:
its size is bounded, and it is checked as options of the command line are.
"""

import json
from dataclasses import asdict
from typing import Any

import msgspec

from aoprecalc.errors import ArgumentError
from aoprecalc.io.images import MAX_TEXT
from aoprecalc.options import ValueOptions

SCHEMA = 1  # version of the document
EXTRAS = "aoprecalc"  # the member of glTF's `extras`

Json = dict[str, Any]


def options_document(options: ValueOptions | None) -> Json | None:
    """Return the JSON object of some options; None for no options, and where its text would be longer than MAX_TEXT."""
    if options is None:
        return None
    document = {"schema": SCHEMA, **asdict(options)}
    return document if len(_text(document)) <= MAX_TEXT else None


def options_text(options: ValueOptions | None) -> str:
    """Return the text of some options, in ASCII; empty where there is no document."""
    document = options_document(options)
    return "" if document is None else _text(document)


def read_options(found: object) -> ValueOptions:
    """Return the options that a text or a JSON object stands for; raises ValueError where it stands for none."""
    try:
        text = found if isinstance(found, str) else _text(found)
        if len(text) > MAX_TEXT:
            raise ValueError(f"it is longer than {MAX_TEXT} characters")
        document = json.loads(text)
        schema = document.pop("schema", None) if isinstance(document, dict) else None
        if schema != SCHEMA:
            raise ValueError(f"its schema is {str(schema)[:20]!a}, {SCHEMA} was expected")
        return msgspec.convert(document, ValueOptions)
    except json.JSONDecodeError as error:
        raise ValueError("it is not JSON") from error
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    except (msgspec.ValidationError, ArgumentError) as error:
        raise ValueError(f"{str(error)[:120]!a}") from error


def _text(document: object) -> str:
    return json.dumps(document, separators=(",", ":"))
