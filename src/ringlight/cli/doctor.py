"""``ringlight doctor``: check this machine and this installation."""

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.cli.parse import parse

if TYPE_CHECKING:
    from ringlight.cli.checks import Finding


@dataclass(frozen=True)
class DoctorArguments:
    """Check this machine and this installation: what works, what is missing, and how to get it.

    The exit code is 1 if something is broken that training needs, else 0.
    """

    json: bool = False
    """Print the findings as JSON."""


def main(arguments: list[str]) -> int:
    """Check; returns the exit code."""
    asked = parse(DoctorArguments, "doctor", arguments)
    from ringlight.cli.checks import findings
    from ringlight.measure.json_record import to_json

    found = []
    for finding in findings():
        found.append(finding)
        if not asked.json:
            sys.stdout.write(_line(finding))
            sys.stdout.flush()
    healthy = not any(finding.essential and finding.state != "ok" for finding in found)
    if asked.json:
        sys.stdout.write(to_json({"healthy": healthy, "findings": found}))
    elif not healthy:
        sys.stderr.write("ringlight doctor: something essential is broken; follow the remedies above\n")
    return 0 if healthy else 1


def _line(finding: "Finding") -> str:
    remedy = f"; {finding.remedy}" if finding.remedy else ""
    return f"{finding.state:8} {finding.name:11} {finding.detail}{remedy}\n"
