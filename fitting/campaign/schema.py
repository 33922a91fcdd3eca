"""The JSON Schema of the campaign file: completion, explanations and checks while it is written.

Editors take it from a remark in the campaign's first line, as taplo and Even Better TOML read it:

    #:schema ./campaign.schema.json

``python -m fitting.campaign.schema > campaign.schema.json`` writes it there. The package ships it
beside this module (`SCHEMA_FILE`).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from fitting.campaign.file import WrittenCampaign
from fitting.text.schema import json_schema

#: The schema as it is shipped.
SCHEMA_FILE = Path(__file__).with_name("campaign.schema.json")


def campaign_schema() -> str:
    """The JSON Schema (draft 7) of a campaign file, with every key's meaning, unit and default."""
    schema = json_schema(WrittenCampaign, title="Campaign of fmu-fit")
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(campaign_schema())
