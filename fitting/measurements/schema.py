"""The JSON Schema of the campaign file: completion, explanations and checks while it is written.

Editors take it from a remark in the campaign's first line, as taplo and Even Better TOML read it:

    #:schema ./campaign.schema.json

``python -m fitting.measurements.schema > campaign.schema.json`` writes it there. The package ships
it in the folder of this module (`SCHEMA_FILE`).
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.file import WrittenCampaign
from fitting.campaign.kind import MeasurementTable
from fitting.measurements.kinds import KINDS
from fitting.text.schema import json_schema

#: The schema as it is shipped.
SCHEMA_FILE = Path(__file__).with_name("campaign.schema.json")


def campaign_schema(kinds: Sequence[type[MeasurementTable]] = KINDS) -> str:
    """The JSON Schema (draft 7) of a campaign file, with every key's meaning, unit and default.

    Args:
        kinds: of measurements that it may contain, besides experiments and a sweep.
    """
    schema = json_schema(WrittenCampaign, title="Campaign of fmu-fit")
    for kind in kinds:
        first = (inspect.getdoc(kind) or "").partition("\n\n")[0]
        table = json_schema(kind, description=" ".join(first.split()))
        table.pop("$schema")
        if kind.REPEATED:
            stated = table.pop("description")
            table = {"type": "array", "minItems": 1, "items": table, "description": stated}
        schema["properties"][kind.TABLE] = table
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(campaign_schema())
