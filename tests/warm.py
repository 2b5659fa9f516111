# ruff: noqa: F401
"""What the server of `tests/isolated.py` has before it forks: all that drive, metrics, picture and doctor import."""

from __future__ import annotations

import contextlib
import gc

import hypothesis
import libsumo
import pandas as pd
import pyarrow.pandas_compat
import pytest
import scipy.ndimage
import scipy.spatial

import vve_sumo.cli.dispatch
import vve_sumo.commissioning.doctor
import vve_sumo.drive.run
import vve_sumo.plotting.drive_page
import vve_sumo.vehicle.dataspeed.simulated
from tests.drive import street
from vve_sumo.drive.provenance import software

software()
# It keeps the street that it reads. Where something is wrong with that, the drives say what.
with contextlib.suppress(Exception):
    street.altered({})
# A collection of garbage in a fork touches, and so copies, all objects but these.
gc.collect()
gc.freeze()
