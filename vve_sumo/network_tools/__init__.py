"""Tools that make what drives read of a street: networks, reference paths, traffic, proving grounds, houses."""
