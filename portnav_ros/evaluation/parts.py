"""Commands of several parts, as ``portnav benchmark graph``: a module each, imported when it is asked for."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Mapping
from types import ModuleType


def declare_parts(parser: argparse.ArgumentParser, parts: Mapping[str, str], what: str) -> None:
    """Declare the parts, name to description; the options behind a part are its own."""
    width = max(map(len, parts))
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = 'parts:\n' + '\n'.join(f'  {name:{width}}  {about}' for name, about in parts.items())
    parser.add_argument('part', choices=parts, metavar='|'.join(parts), help=what)
    parser.add_argument('options', nargs=argparse.REMAINDER, help='those of the part; see PART --help')


def open_part(
    command: str, name: str, about: str, package: str = 'evaluation'
) -> tuple[ModuleType, argparse.ArgumentParser]:
    """Import the module ``COMMAND_NAME`` of a package; returns it with the parser of its options."""
    module = importlib.import_module(f'portnav_ros.{package}.{command}_{name}')
    parser = argparse.ArgumentParser(prog=f'portnav {command} {name}', description=about)
    module.add_arguments(parser)
    return module, parser
