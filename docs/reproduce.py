"""Write reproduction.md from reproduction.json: `python docs/reproduce.py [RESULT.json]`.

With a result (as `nerfmodal reproduce paper` writes it) that one is stored beside the page first.
"""

import json
import shutil
import sys
from pathlib import Path

from nerfmodal.reproduction import page

HERE = Path(__file__).parent


def main() -> None:
    """Store the result that is given, then write the page of the stored one."""
    stored = HERE / "reproduction.json"
    if len(sys.argv) > 1:
        shutil.copyfile(sys.argv[1], stored)
    (HERE / "reproduction.md").write_text(page(json.loads(stored.read_text())))


if __name__ == "__main__":
    main()
