"""What a check has found, and how to mend it: as lines and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """What one check saw, and how to mend it where it is not ok."""

    check: str
    status: Literal['ok', 'warn', 'fail']
    found: str
    mend: str = ''


def show(findings: Sequence[Finding], good: str, file: str | None = None) -> int:
    """Print findings and write them as JSON; returns 1 if any failed, else 0.

    Args:
        findings: in the order to be read.
        good: the last line where nothing has failed.
        file: to write JSON to, `-` for standard output in place of the lines.
    """
    text = json.dumps([finding._asdict() for finding in findings], indent=2)
    if file == '-':
        print(text)
    else:
        if file:
            Path(file).write_text(text + '\n', encoding='utf-8')
        print('\n'.join(_lines(findings, good)))
    return 1 if any(finding.status == 'fail' for finding in findings) else 0


def _lines(findings: Sequence[Finding], good: str) -> Iterator[str]:
    width = max([13, *(len(finding.check) for finding in findings)])
    for finding in findings:
        yield f'{finding.status:4}  {finding.check:{width}}  {finding.found}'
        if finding.mend:
            yield f'      {"":{width}}  -> {finding.mend}'
    bad = dict.fromkeys(finding.check for finding in findings if finding.status == 'fail')
    yield f'\n{len(bad)} to mend: {", ".join(bad)}' if bad else f'\n{good}'
