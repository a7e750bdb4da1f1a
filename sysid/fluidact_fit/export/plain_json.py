"""The whole parameter document as JSON."""

from __future__ import annotations

import json

from .target import Job


def write(job: Job) -> dict[str, bytes]:
    """Return ``NAME.json``.

    The document as the command line shows it with ``--json``: JSON holds the shortest digits
    that are read back as the same float64. What was accepted stands among the warnings, where
    a document has room for it.
    """
    document = job.block.document.to_dict()
    document["warnings"] = [
        *document["warnings"],
        *({"code": "exported-as-accepted", "message": remark} for remark in job.remarks),
    ]
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    return {f"{job.file}.json": text.encode("ascii")}
