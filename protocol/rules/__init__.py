"""What processes must work out alike: levels, lattices, orders, footprints, packet bits."""
