"""Which files of the console import which, so that a browser may ask for all that a page needs at once."""

import posixpath
import re
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Final

SHELL: Final = "app/main.js"
PAGES: Final = "pages"
STATIC: Final = re.compile(rb'\bfrom\s*"(\.[^"]+)"')
"""An import (or an export from elsewhere) that the browser resolves before a module runs; `import()` is not one."""


def of_shell(contents: Mapping[str, bytes]) -> Sequence[str]:
    """The files that every page needs, by name."""
    return sorted(_closure(SHELL, contents))


def of_pages(contents: Mapping[str, bytes]) -> Mapping[str, Sequence[str]]:
    """The files that each file of `pages/` needs beyond the shell, itself among them, by its name without suffix."""
    shell = _closure(SHELL, contents)
    files = [name for name in contents if PurePosixPath(name).parent == PurePosixPath(PAGES)]
    return {PurePosixPath(name).stem: sorted(_closure(name, contents) - shell) for name in sorted(files)}


def _closure(name: str, contents: Mapping[str, bytes]) -> set[str]:
    found, rest = set[str](), [name]
    while rest:
        one = rest.pop()
        if one not in found:
            found.add(one)
            here = posixpath.dirname(one)
            rest += [posixpath.normpath(posixpath.join(here, path.decode())) for path in STATIC.findall(contents[one])]
    return found
