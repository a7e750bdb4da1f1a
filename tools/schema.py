"""Write the JSON Schema that comes with the package (``make schema``)."""

from __future__ import annotations

from pathlib import Path

from fluidact_fit.families import family_names, get_family
from fluidact_fit.parameters import schema


def main() -> None:
    """Build it from the models and the registry."""
    path = Path(schema.__file__).with_name(schema.FILE_NAME)
    text = schema.schema_text(schema.build_schema(map(get_family, family_names())))
    path.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
