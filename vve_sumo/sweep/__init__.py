"""Many drives: each in a process of its own, as many at a time as there are processors, here or on a cluster."""
