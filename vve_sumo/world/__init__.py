"""The street: SUMO's network, traffic, obstacles, and the ego in it; the only room that imports libsumo."""

import os

# Before libsumo is imported anywhere: without it libsumo prints two lines to stdout when the installed pyarrow is
# not the release it bundles.
os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")
