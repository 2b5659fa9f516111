"""`python -m vve_sumo.cli` is `vve-sumo`."""

from __future__ import annotations

import sys

from vve_sumo.cli import main

if __name__ == "__main__":
    sys.exit(main())
