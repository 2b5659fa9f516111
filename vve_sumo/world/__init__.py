"""The virtual road: SUMO's network, traffic, obstacles and the ego; the package that imports libsumo."""

import os

# Must be set before libsumo is imported: without it libsumo prints two lines to stdout when the installed pyarrow is
# not the release that it bundles.
os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")
