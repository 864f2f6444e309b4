"""A lab's cluster, measured with one, two, three … of its machines."""
