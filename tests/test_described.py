"""The docstrings below the fields of a model describe them, in its own tables and in its JSON Schema."""

from __future__ import annotations

from pydantic import Field

import mkdaemon.daemon  # noqa: F401 - its models are looked at
from mkdaemon.described import Described, meanings_of


class Inner(Described):
    depth: float
    """How deep it is [m]."""


class Base(Described):
    kept: int = 0
    """Said by the base."""
    changed: int = 0
    """Said by the base, too."""


class Outer(Base):
    changed: int = 1
    inner: Inner
    """What is
    inside."""
    said: int = Field(default=0, description="Said in place.")
    """Not read."""
    bare: int = 0

    class Nested(Described):
        deeper: int
        """Inside a class."""


def test_meanings_are_the_docstrings_of_the_fields_in_their_order():
    assert meanings_of(Outer) == {
        "kept": "Said by the base.",
        "changed": "",
        "inner": "What is\ninside.",
        "said": "Said in place.",
        "bare": "",
    }
    assert list(meanings_of(Outer)) == list(Outer.model_fields)
    assert meanings_of(Outer.Nested) == {"deeper": "Inside a class."}


def test_the_schema_describes_fields_and_those_of_models_inside():
    schema = Outer.model_json_schema()
    described = {name: part.get("description") for name, part in schema["properties"].items()}
    assert described == {name: meaning or None for name, meaning in meanings_of(Outer).items()}
    assert schema["$defs"]["Inner"]["properties"]["depth"]["description"] == "How deep it is [m]."


def test_no_model_of_the_daemon_has_its_docstrings_read_while_it_is_imported():
    models = [Described]
    for model in models:
        models += model.__subclasses__()
    assert len(models) > 200
    assert not any(model.model_config.get("use_attribute_docstrings") for model in models)
